// Computes a 2D convolution (cross-correlation) of kernel 1, 3 or 5 with stride 1 and zero padding:
//   out(o, y, x) = act(bias(o) + sum(o, y, x)) + residuals
//   sum(o, y, x) = sum over i, kx, ky of weight(o, i, ky, kx) in(i, y + ky - r, x + kx - r)
// Here r = kernel / 2, act is ReLU or nothing, and residuals are added in their order, after the activation.
// The input is space_to_depth() of the bound image by kUnshuffle, if that is above 1. The result is stored
// after pixel_shuffle() by kShuffle, if that is above 1, and residuals have the shuffled shape.
//
// Each invocation computes kVectors * 4 output channels of kRows pixels in one column, so that a weight
// serves kRows pixels and an input value all channels of the block. Neighbouring invocations are
// neighbours in x.
// Where its pixels lie, and which of them are in the image, is found once for all channels, so that no load
// takes a branch or waits for another.
//
// Input channels are taken one by one in 32 bits, and by pairs in 16 bits. A pair takes two multiply-adds, or
// one dot product with HALF_DOTS. Sums have 32 bits. The last of an odd number of channels is paired with
// itself, and its weights are divided among both. Weights lie as [channels_out / (4 kVectors)][channels_in or
// pairs of them][kx][ky][kVectors][4 outputs], padded with zeros.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "loops.glsl"
#ifdef HALF_DOTS
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#extension GL_EXT_spirv_intrinsics : require
#endif

#ifndef STORAGE_F16
const uint kGroup = 1;
#define VALUES float
#define READ(data, pixel) data[first + (pixel)]
#define WEIGHTS vec4

vec4 add_products(vec4 w, float value, vec4 sum) { return fma(w, vec4(value), sum); }
#else
const uint kGroup = 2;
#define READ(data, pixel) VALUES(data[first + (pixel)], data[second + (pixel)])
#define WEIGHTS uvec4
#ifdef HALF_DOTS
#define VALUES f16vec2
#define WEIGHTS_OF unpackFloat2x16
// This is OpFDot2MixAcc32VALVE.
spirv_instruction(extensions = ["SPV_VALVE_mixed_float_dot_product"], capabilities = [6912], id = 6916)
float add_dot(f16vec2 a, f16vec2 b, float sum);
#else
#define VALUES vec2
#define WEIGHTS_OF unpackHalf2x16

float add_dot(vec2 a, vec2 b, float sum) { return fma(a.y, b.y, fma(a.x, b.x, sum)); }
#endif

vec4 add_products(uvec4 w, VALUES values, vec4 sum) {
  [[unroll]] for (uint i = 0; i < 4; ++i) sum[i] = add_dot(WEIGHTS_OF(w[i]), values, sum[i]);
  return sum;
}
#endif

#include "conv2d.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
#include "invocation.glsl"
layout(constant_id = 0) const uint kKernel = 3;
layout(constant_id = 2) const uint kRows = 4;
const uint kRadius = kKernel / 2;
const uint kColumn = kRows + kKernel - 1;

uint groups_of(uint channels) { return (channels + kGroup - 1) / kGroup; }

void main() {
  uvec3 id = global_invocation_id();
  uint x = id.x, y0 = id.y * kRows, block = id.z;
  if (x >= p.width || y0 >= p.height) return;

  vec4 sum[kRows][kVectors];
  [[unroll]] for (uint r = 0; r < kRows; ++r) {
    [[unroll]] for (uint v = 0; v < kVectors; ++v) sum[r][v] = bias[block * kVectors + v];
  }
  bool inside[kKernel][kColumn];
  uint pixel[kKernel][kColumn];
  [[unroll]] for (uint kx = 0; kx < kKernel; ++kx) {
    [[unroll]] for (uint r = 0; r < kColumn; ++r)
      pixel[kx][r] = pixel_at(y0 + r - kRadius, x + kx - kRadius, inside[kx][r]);
  }
  uint channels_first = kSecondInput != 0 ? p.channels_first : p.channels_in;
  uint groups_first = groups_of(channels_first), groups_second = groups_of(p.channels_in - channels_first);
  uint weight = block * (groups_first + groups_second) * kKernel * kKernel * kVectors;
#define ADD_CHANNELS(data, channels, groups)                                                                 \
  FOR_EACH(i, groups) {                                                                                      \
    uint first = source_of(kGroup * i), second = source_of(min(kGroup * i + 1, channels - 1));               \
    [[unroll]] for (uint kx = 0; kx < kKernel; ++kx) {                                                       \
      VALUES column[kColumn];                                                                                \
      [[unroll]] for (uint r = 0; r < kColumn; ++r) {                                                        \
        VALUES values = READ(data, pixel[kx][r]);                                                            \
        column[r] = inside[kx][r] ? values : VALUES(0.0);                                                    \
      }                                                                                                      \
      [[unroll]] for (uint ky = 0; ky < kKernel; ++ky) {                                                     \
        [[unroll]] for (uint v = 0; v < kVectors; ++v) {                                                     \
          WEIGHTS w = weights[weight++];                                                                     \
          [[unroll]] for (uint r = 0; r < kRows; ++r) sum[r][v] = add_products(w, column[r + ky], sum[r][v]);\
        }                                                                                                    \
      }                                                                                                      \
    }                                                                                                        \
  }
  ADD_CHANNELS(in_data, channels_first, groups_first)
  if (kSecondInput != 0) ADD_CHANNELS(second_data, p.channels_in - channels_first, groups_second)
  [[unroll]] for (uint r = 0; r < kRows; ++r) {
    if (y0 + r >= p.height) break;
    store_block(block, y0 + r, x, sum[r]);
  }
  count_saturated();
}
