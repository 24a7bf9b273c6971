// Computes a 2D convolution (cross-correlation) of kernel 1 or 3 with stride 1 and zero padding:
//   out(o, y, x) = act(bias(o) + sum(o, y, x)) + residuals
//   sum(o, y, x) = sum over i, kx, ky of weight(o, i, ky, kx) in(i, y + ky - r, x + kx - r)
// Here r = kernel / 2, act is ReLU or nothing, and residuals are added in their order, after the activation.
//
// Each invocation computes kVectors * 4 output channels of kRows pixels in one column, so that a weight
// serves kRows pixels and an input value all channels of the block. Neighbouring invocations are
// neighbours in x.
// Weights lie as [channels_out / (4 kVectors)][channels_in][kx][ky][kVectors] vec4, padded with zeros.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "border.glsl"

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
layout(std430, binding = 1) readonly buffer Weights { STORAGE4 weights[]; };
layout(std430, binding = 2) readonly buffer Bias { vec4 bias[]; };
layout(std430, binding = 3) readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 4) writeonly buffer Output { STORAGE out_data[]; };
// The input is bound in place of residuals that are missing.
layout(std430, binding = 5) readonly buffer Residual0 { STORAGE residual0[]; };
layout(std430, binding = 6) readonly buffer Residual1 { STORAGE residual1[]; };
layout(std430, binding = 7) readonly buffer Residual2 { STORAGE residual2[]; };
// The input is bound where there is no second input.
layout(std430, binding = 8) readonly buffer Second { STORAGE second_data[]; };

const uint kRadius = kKernel / 2;
const uint kColumn = kRows + kKernel - 1;

// Returns 0 outside the image; unsigned wrap-around makes one comparison serve both edges.
float load(uint i, uint y, uint x) {
  bool inside = y < p.height && x < p.width;
  bool second = kSecondInput != 0 && i >= p.channels_first;
  uint at = inside ? address(second ? i - p.channels_first : i, y, x, p.plane, p.width) : 0;
  float value = second ? float(second_data[at]) : float(in_data[at]);
  return inside ? value : 0.0;
}

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
  uint weight = block * p.channels_in * kKernel * kKernel * kVectors;
  for (uint i = 0; i < p.channels_in; ++i) {
    [[unroll]] for (uint kx = 0; kx < kKernel; ++kx) {
      float column[kColumn];
      [[unroll]] for (uint r = 0; r < kColumn; ++r) column[r] = load(i, y0 + r - kRadius, x + kx - kRadius);
      [[unroll]] for (uint ky = 0; ky < kKernel; ++ky) {
        [[unroll]] for (uint v = 0; v < kVectors; ++v) {
          vec4 w = vec4(weights[weight++]);
          [[unroll]] for (uint r = 0; r < kRows; ++r) sum[r][v] = fma(w, vec4(column[r + ky]), sum[r][v]);
        }
      }
    }
  }
  [[unroll]] for (uint r = 0; r < kRows; ++r) {
    if (y0 + r >= p.height) break;
    [[unroll]] for (uint v = 0; v < kVectors; ++v) {
      [[unroll]] for (uint k = 0; k < 4; ++k) {
        uint o = (block * kVectors + v) * 4 + k;
        if (o < p.channels_out) store(o, y0 + r, x, sum[r][v][k]);
      }
    }
  }
}
