// Returns the top left pixel of a tile.
uvec2 corner(uint tile, uint first_tile_row, uint tiles_x) {
  uint row = quotient(tile, tiles_x);
  return uvec2(tile - row * tiles_x, first_tile_row + row) * kTile;
}

// Returns the top left pixel of the two tiles side by side that an invocation computes.
uvec2 pair_corner(uint first_tile_row, uint tiles_x) {
  uint id = global_invocation_id().x, columns = tiles_x / 2, row = quotient(id, columns);
  return uvec2(id - row * columns, first_tile_row + row) * uvec2(2 * kTile, kTile);
}
