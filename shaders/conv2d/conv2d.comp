// Computes a 2D convolution (cross-correlation) of kernel 1 or 3 with stride 1 and zero padding:
//   out(o, y, x) = act(bias(o) + sum(o, y, x)) + residuals
//   sum(o, y, x) = sum over i, kx, ky of weight(o, i, ky, kx) in(i, y + ky - r, x + kx - r)
// Here r = kernel / 2, act is ReLU or nothing, and residuals are added in their order, after the activation.
//
// Each invocation computes kVectors * 4 output channels of kRows pixels in one column, so that a weight
// serves kRows pixels and an input value all channels of the block. Neighbouring invocations are
// neighbours in x.
// Where its pixels lie, and which of them are in the image, is found once for all channels, so that no load
// takes a branch or waits for another.
// Weights lie as [channels_out / (4 kVectors)][channels_in][kx][ky][kVectors] vec4, padded with zeros.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "border.glsl"
#include "loops.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
#include "invocation.glsl"
layout(constant_id = 0) const uint kKernel = 3;
layout(constant_id = 1) const uint kVectors = 2;
layout(constant_id = 2) const uint kRows = 4;
layout(constant_id = 3) const uint kRelu = 0;
layout(constant_id = 4) const uint kResiduals = 0;
layout(constant_id = 5) const uint kSecondInput = 0;  // a second input has channels from p.channels_first on
layout(constant_id = 6) const uint kBorders = 0;  // the bias is a table, see border.glsl

layout(push_constant) uniform Push {
  Conv2d p;
};
layout(std430, binding = 1) restrict readonly buffer Weights { STORAGE4 weights[]; };
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

void store(uint o, uint y, uint x, float value) {
  uint at = address(o, y, x, p.plane, p.width);
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
      pixel[kx][r] = inside[kx][r] ? py * p.width + px : 0;
    }
  }
  uint weight = block * p.channels_in * kKernel * kKernel * kVectors;
#define ADD_CHANNELS(data, count)                                                                            \
  FOR_EACH(i, count) {                                                                                       \
    [[unroll]] for (uint kx = 0; kx < kKernel; ++kx) {                                                       \
      float column[kColumn];                                                                                 \
      [[unroll]] for (uint r = 0; r < kColumn; ++r) {                                                        \
        float value = float(data[i * p.plane + pixel[kx][r]]);                                               \
        column[r] = inside[kx][r] ? value : 0.0;                                                             \
      }                                                                                                      \
      [[unroll]] for (uint ky = 0; ky < kKernel; ++ky) {                                                     \
        [[unroll]] for (uint v = 0; v < kVectors; ++v) {                                                     \
          vec4 w = vec4(weights[weight++]);                                                                  \
          [[unroll]] for (uint r = 0; r < kRows; ++r) sum[r][v] = fma(w, vec4(column[r + ky]), sum[r][v]);   \
        }                                                                                                    \
      }                                                                                                      \
    }                                                                                                        \
  }
  uint channels_first = kSecondInput != 0 ? p.channels_first : p.channels_in;
  ADD_CHANNELS(in_data, channels_first)
  if (kSecondInput != 0) ADD_CHANNELS(second_data, p.channels_in - channels_first)
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
