// Computes a 2D convolution (cross-correlation) of kernel 1 or 3 with stride 1 and zero padding:
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
#include "border.glsl"
#include "loops.glsl"
#ifdef HALF_DOTS
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#extension GL_EXT_spirv_intrinsics : require
#endif

layout(local_size_x = 32, local_size_y = 2) in;
#include "invocation.glsl"
layout(constant_id = 0) const uint kKernel = 3;
layout(constant_id = 1) const uint kVectors = 2;
layout(constant_id = 2) const uint kRows = 4;
layout(constant_id = 3) const uint kRelu = 0;
layout(constant_id = 4) const uint kResiduals = 0;
layout(constant_id = 5) const uint kSecondInput = 0;  // a second input has channels from p.channels_first on
layout(constant_id = 6) const uint kBorders = 0;  // the bias is a table, see border.glsl
layout(constant_id = 7) const uint kUnshuffle = 1;  // 1 where there is a second input
layout(constant_id = 8) const uint kShuffle = 1;

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

layout(push_constant) uniform Push {
  Conv2d p;
};
layout(std430, binding = 1) restrict readonly buffer Weights { WEIGHTS weights[]; };
layout(std430, binding = 2) restrict readonly buffer Bias { vec4 bias[]; };
layout(std430, binding = 3) restrict readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 4) restrict writeonly buffer Output { STORAGE out_data[]; };
// The input is bound in place of residuals that are missing.
layout(std430, binding = 5) restrict readonly buffer Residual0 { STORAGE residual0[]; };
layout(std430, binding = 6) restrict readonly buffer Residual1 { STORAGE residual1[]; };
layout(std430, binding = 7) restrict readonly buffer Residual2 { STORAGE residual2[]; };
// The input is bound where there is no second input.
layout(std430, binding = 8) restrict readonly buffer Second { STORAGE second_data[]; };

const uint kRadius = kKernel / 2;
const uint kColumn = kRows + kKernel - 1;

uint groups_of(uint channels) { return (channels + kGroup - 1) / kGroup; }

// Returns where channel i of the unshuffled input starts.
uint source_of(uint i) {
  uvec3 at = shuffled(kUnshuffle, i, 0, 0);
  return address(at.x, at.y, at.z, p.plane_in, kUnshuffle * p.width);
}

void store(uint o, uint y, uint x, float value) {
  uvec3 place = shuffled(kShuffle, o, y, x);
  uint at = address(place.x, place.y, place.z, p.plane_out, kShuffle * p.width);
  if (kRelu != 0) value = rectified(value);
  if (kResiduals > 0) value += float(residual0[at]);
  if (kResiduals > 1) value += float(residual1[at]);
  if (kResiduals > 2) value += float(residual2[at]);
  out_data[at] = STORAGE(storable(value));
}

void main() {
  uvec3 id = global_invocation_id();
  uint x = id.x, y0 = id.y * kRows, block = id.z;
  if (x >= p.width || y0 >= p.height) return;

  vec4 sum[kRows][kVectors];
  [[unroll]] for (uint r = 0; r < kRows; ++r) {
    uint first = block * kVectors;
    if (kBorders != 0) {
      uint blocks = (p.channels_out + 4 * kVectors - 1) / (4 * kVectors);
      first += border_case(y0 + r, x, p.height, p.width) * blocks * kVectors;
    }
    [[unroll]] for (uint v = 0; v < kVectors; ++v) sum[r][v] = bias[first + v];
  }
  bool inside[kKernel][kColumn];
  uint pixel[kKernel][kColumn];
  [[unroll]] for (uint kx = 0; kx < kKernel; ++kx) {
    [[unroll]] for (uint r = 0; r < kColumn; ++r) {
      uint py = y0 + r - kRadius, px = x + kx - kRadius;
      inside[kx][r] = py < p.height && px < p.width;  // unsigned wrap-around serves both edges
      pixel[kx][r] = inside[kx][r] ? kUnshuffle * (py * kUnshuffle * p.width + px) : 0;
    }
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
    [[unroll]] for (uint v = 0; v < kVectors; ++v) {
      [[unroll]] for (uint k = 0; k < 4; ++k) {
        uint o = (block * kVectors + v) * 4 + k;
        if (o < p.channels_out) store(o, y0 + r, x, sum[r][v][k]);
      }
    }
  }
  count_saturated();
}
