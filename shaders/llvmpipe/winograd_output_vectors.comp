// Computes the same as winograd_output.comp after winograd_multiply_vectors.comp with kPaired, where the
// products of two tiles that are kVector apart lie side by side. Each invocation computes two such tiles of
// kOutputs output channels; z counts these groups of channels.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#define VECTOR_PUSH uint digits[4];
#include "memory.glsl"
#include "winograd.glsl"

layout(local_size_x = 32) in;
#include "invocation.glsl"
#include "winograd_output.glsl"
layout(constant_id = 5) const uint kVector = 8;
layout(constant_id = 6) const uint kOutputs = 1;  // 2: both are neighbours in the target, stored as a pair
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"
#include "tile_pair.glsl"

void main() {
  uint o = kOutputs * uniform_number(gl_WorkGroupID.z), tile = 2 * first_of_vector().x;
  uvec2 corners[2];
  [[unroll]] for (uint i = 0; i < 2; ++i)
    corners[i] = corner(tile + tile_of_pairs(i * kVector + gl_SubgroupInvocationID, kVector),
                        p.first_tile_row, p.tiles_x);
  vec2 result[2][kMostSide][kMostSide];  // [output channel][row][column], a component for each tile
  [[unroll]] for (uint k = 0; k < kOutputs; ++k) {
    uint at = element(0, o + k, tile, p.position_stride, p.channels);
    [[unroll]] for (uint x = 0; x < kSide; ++x) {
      vec2 m[kMostSide];
      [[unroll]] for (uint y = 0; y < kSide; ++y) {
        Floats both = Floats(uint64_t(products) + 4ul * (at + (y * kSide + x) * p.position_stride));
        m[y] = vec2(read_vector(both, 0), read_vector(both, kVector));
      }
      transform_sums(m);
      [[unroll]] for (uint y = 0; y < kTile; ++y) result[k][y][x] = m[y];
      keep_order(result[k][0][x].x + result[k][0][x].y);
    }
    finish(o + k, result[k]);
  }
  if (end_order()) return;
  if (kOutputs == 1) {
    store_tiles(o, corners, result[0]);
    count_saturated();
    return;
  }
  [[unroll]] for (uint y = 0; y < kTile; ++y) {
    [[unroll]] for (uint side = 0; side < 2; ++side) {
      [[unroll]] for (uint x = 0; x < kTile; ++x)
        store_pair(o, corners[side].y + y, corners[side].x + x,
                   vec2(result[0][y][x][side], result[1][y][x][side]));
    }
  }
}
