#include "place.glsl"

// Of the two tiles side by side that an invocation makes, in pixels. `first_tile_row`: of the image or, in a sparse graph, of
// each block, which is as many tiles wide as high.
uvec2 pair_corner(uint first_tile_row, uint tiles_x) {
  uvec2 pair = uvec2(gl_GlobalInvocationID.x % (tiles_x / 2), first_tile_row + gl_GlobalInvocationID.x / (tiles_x / 2));
  if (kItemColumns != 0) {
    Item listed = listed_item();
    pair = listed.block * uvec2(1, 2) * kItemColumns + listed.inner + uvec2(0, first_tile_row);
  }
  return pair * uvec2(2 * kTile, kTile);
}
