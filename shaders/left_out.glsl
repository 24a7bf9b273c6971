// Which pixels a pass of a sparse graph leaves out that has an invocation for each of them: those of blocks too far from what
// is needed.
#include "sparse.glsl"

layout(constant_id = 30) const uint kBlockSide = 0;  // in pixels; 0: none is left out
layout(constant_id = 31) const uint kRadius = 0;     // in blocks

bool is_left_out(uvec2 pixel) {
  if (kBlockSide == 0) return false;
  uint columns = (sparse_size().x + RAYMELD_SPARSE_SIDE - 1) / RAYMELD_SPARSE_SIDE;
  uvec2 block = pixel / kBlockSide;
  return sparse_word(RAYMELD_SPARSE_DISTANCES + block.y * columns + block.x) > kRadius;
}
