// Computes the last of three steps of a Winograd convolution: A^T m A of every tile and output channel of a
// band of rows, then bias, ReLU and residuals as in conv2d.comp. With kShuffle r > 1, pixel_shuffle() by r of
// the result is stored, and residuals have the shuffled shape. Each invocation computes two tiles side by
// side; z is the output channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "winograd.glsl"

layout(local_size_x = 32) in;
#include "invocation.glsl"
#include "winograd_output.glsl"
#include "tile_pair.glsl"

void main() {
  uint o = global_invocation_id().z, tile = 2 * global_invocation_id().x;
  uvec2 corner = pair_corner(p.first_tile_row, p.tiles_x);
  uvec2 corners[2] = {corner, corner + uvec2(kTile, 0)};
  vec2 result[kMostSide][kMostSide];  // [row][column], a component for each tile
  uint at = element(0, o, tile, p.position_stride, p.channels);
  [[unroll]] for (uint x = 0; x < kSide; ++x) {
    vec2 m[kMostSide];
    [[unroll]] for (uint y = 0; y < kSide; ++y)
      m[y] = READ_PAIR(products, at + (y * kSide + x) * p.position_stride);
    transform_sums(m);
    [[unroll]] for (uint y = 0; y < kTile; ++y) result[y][x] = m[y];
  }
  finish(o, result);
  store_tiles(o, corners, result);
  count_saturated();
}
