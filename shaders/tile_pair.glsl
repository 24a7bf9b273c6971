#include "place.glsl"

// Of the two tiles side by side that an invocation makes, in pixels.
uvec2 pair_corner(uint first_tile_row, uint tiles_x) {
  uvec2 pair = item();
  if (kItemColumns == 0) pair = uvec2(pair.x % (tiles_x / 2), first_tile_row + pair.x / (tiles_x / 2));
  return pair * uvec2(2 * kTile, kTile);
}
