#include "place.glsl"

// n / d, without the division of integers that few devices have: exact below 2^20, as a quotient of floats is wrong by 2.5
// units in the last place at most.
uint quotient(uint n, uint d) { return uint((float(n) + 0.5) / float(d)); }

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
