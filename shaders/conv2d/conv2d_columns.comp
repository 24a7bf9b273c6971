// Computes the convolution of conv2d.comp with a kernel of 3 x 3 by Winograd's F(kTile, 3) along columns, and
// directly across rows (Lavin and Gray 2016, in one dimension):
//   sum(o, y0 .. y0 + kTile - 1, x) = A^T sum over i, kx of (G w(o, i, kx)) * (B^T d(i, x + kx - 1))
// Here w(o, i, kx) is a column of the filter, and d(i, x) has the values of column x from y0 - 1 to
// y0 + kTile. F(4, 3) takes half of the multiplications, and errors grow less than in winograd_*.comp, which
// transforms twice.
//
// Each invocation computes kVectors * 4 output channels of kTile pixels in two neighbouring columns, which
// share weights and transformed columns. All that is transformed has 32 bits. Weights lie as
// [channels_out / (4 kVectors)][channels_in][kx][position][kVectors][4 outputs], padded with zeros.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "loops.glsl"
#include "winograd.glsl"
#include "winograd_transforms.glsl"
#define WEIGHTS vec4
#include "conv2d.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
#include "invocation.glsl"

void main() {
  uvec3 id = global_invocation_id();
  uint x0 = 2 * id.x, y0 = id.y * kTile, block = id.z;
  if (x0 >= p.width || y0 >= p.height) return;

  vec4 sum[2][kMostSide][kVectors];  // [column][position]
  [[unroll]] for (uint c = 0; c < 2; ++c) {
    [[unroll]] for (uint i = 0; i < kSide; ++i) {
      [[unroll]] for (uint v = 0; v < kVectors; ++v) sum[c][i][v] = vec4(0.0);
    }
  }
  bool row_inside[kMostSide], column_inside[4];
  uint row[kMostSide], column[4];
  [[unroll]] for (uint r = 0; r < kSide; ++r) row[r] = pixel_at(y0 + r - 1, 0, row_inside[r]);
  [[unroll]] for (uint c = 0; c < 4; ++c) column[c] = pixel_at(0, x0 + c - 1, column_inside[c]);
  uint channels_first = kSecondInput != 0 ? p.channels_first : p.channels_in;
  uint weight = block * p.channels_in * kKernel * kSide * kVectors;
#define ADD_CHANNELS(data, channels)                                                                         \
  FOR_EACH(i, channels) {                                                                                    \
    uint first = source_of(i);                                                                               \
    vec2 d[kMostSide]; /* a transformed column, and the next one */                                          \
    [[unroll]] for (uint c = 0; c < 4; ++c) {                                                                \
      vec2 next[kMostSide]; /* both components are the same */                                               \
      [[unroll]] for (uint r = 0; r < kSide; ++r) {                                                          \
        float value = float(data[first + row[r] + column[c]]);                                               \
        next[r] = vec2(row_inside[r] && column_inside[c] ? value : 0.0);                                     \
      }                                                                                                      \
      transform_input(next);                                                                                 \
      [[unroll]] for (uint r = 0; r < kSide; ++r) d[r] = vec2(c > 0 ? d[r].y : 0.0, next[r].x);              \
      if (c > 0) [[unroll]] for (uint k = 0; k < kSide; ++k) {                                               \
        [[unroll]] for (uint v = 0; v < kVectors; ++v) {                                                     \
          vec4 w = weights[weight++];                                                                        \
          sum[0][k][v] = fma(w, vec4(d[k].x), sum[0][k][v]);                                                 \
          sum[1][k][v] = fma(w, vec4(d[k].y), sum[1][k][v]);                                                 \
        }                                                                                                    \
      }                                                                                                      \
    }                                                                                                        \
  }
  ADD_CHANNELS(in_data, channels_first)
  if (kSecondInput != 0) ADD_CHANNELS(second_data, p.channels_in - channels_first)
  [[unroll]] for (uint v = 0; v < kVectors; ++v) {
    [[unroll]] for (uint k = 0; k < 4; ++k) {
      vec2 m[kMostSide];
      [[unroll]] for (uint i = 0; i < kSide; ++i) m[i] = vec2(sum[0][i][v][k], sum[1][i][v][k]);
      transform_sums(m);
      [[unroll]] for (uint r = 0; r < kTile; ++r) sum[0][r][v][k] = m[r].x, sum[1][r][v][k] = m[r].y;
    }
  }
  [[unroll]] for (uint c = 0; c < 2; ++c) {
    [[unroll]] for (uint r = 0; r < kTile; ++r) {
      uint y = y0 + r, x = x0 + c;
      if (y < p.height && x < p.width) {
        [[unroll]] for (uint v = 0; v < kVectors; ++v) sum[c][r][v] += bias[block * kVectors + v];
        store_block(block, y, x, sum[c][r]);
      }
    }
  }
  count_saturated();
}
