#include "place.glsl"

// Of a tile of a dense graph, in pixels.
uvec2 corner(uint tile, uint first_tile_row, uint tiles_x) {
  uint row = quotient(tile, tiles_x);
  return uvec2(tile - row * tiles_x, first_tile_row + row) * kTile;
}

// Of the two tiles side by side that an invocation makes, in pixels. `first_tile_row`: of the image or, in a sparse graph, of
// each block, which is as many tiles wide as high.
uvec2 pair_corner(uint first_tile_row, uint tiles_x) {
  uint id = global_invocation_id().x, columns = tiles_x / 2, row = quotient(id, columns);
  uvec2 pair = uvec2(id - row * columns, first_tile_row + row);
  if (kItemColumns != 0) {
    Item listed = listed_item();
    pair = listed.block * uvec2(1, 2) * kItemColumns + listed.inner + uvec2(0, first_tile_row);
  }
  return pair * uvec2(2 * kTile, kTile);
}
