// Computes the same 2D convolution as conv2d.comp with cooperative matrices: 16-bit factors, 32-bit sums.
// sum(o, pixel) is a matrix product of weights (o, i) and inputs (i, pixel), added up over chunks of
// kChannels input channels and, in each chunk, over the taps.
//
// A workgroup computes kOutputs * kM output channels of kSubgroups * kRows rows of kColumns pixels, and a
// subgroup kRows of these rows; z is the block of output channels. A chunk of the input, with the border that
// the taps reach, is transposed on its way into shared memory: the channels of a pixel lie side by side, so
// that each tap's matrix is only an offset away.
// Weights lie as [block][chunk][kOutputs * kM][kTaps][kChannels], zero where channels end early.
//
// The input is space_to_depth() of the bound image by kUnshuffle, if that is above 1. The result is stored
// after pixel_shuffle() by kShuffle, if that is above 1, and residuals have the shuffled shape.
#version 450
#pragma use_vulkan_memory_model
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#extension GL_KHR_cooperative_matrix : require
#extension GL_KHR_memory_scope_semantics : require
#extension GL_KHR_shader_subgroup_basic : require
#include "params.h"
#include "tensor.glsl"
#include "border.glsl"

layout(local_size_x_id = 0) in;  // kSubgroups times the subgroup size
layout(constant_id = 1) const uint kSubgroups = 4;
layout(constant_id = 2) const uint kM = 16;
layout(constant_id = 3) const uint kN = 16;
layout(constant_id = 4) const uint kK = 16;
layout(constant_id = 5) const uint kOutputs = 4;
layout(constant_id = 6) const uint kRows = 2;
layout(constant_id = 7) const uint kChannels = 16;
layout(constant_id = 8) const uint kKernel = 3;
layout(constant_id = 9) const uint kRelu = 0;
layout(constant_id = 10) const uint kResiduals = 0;
layout(constant_id = 11) const uint kUnshuffle = 1;
layout(constant_id = 12) const uint kShuffle = 1;
layout(constant_id = 13) const uint kSecondInput = 0;  // a second input has channels from p.channels_first on
layout(constant_id = 14) const uint kBorders = 0;  // the bias is a table, see border.glsl

layout(push_constant) uniform Push { Conv2dMatrix p; };
layout(std430, binding = 1) readonly buffer Weights { uvec4 weights[]; };
layout(std430, binding = 2) readonly buffer Bias { float bias[]; };
layout(std430, binding = 3) readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 4) writeonly buffer Output { STORAGE out_data[]; };
// The input is bound in place of residuals that are missing.
layout(std430, binding = 5) readonly buffer Residual0 { STORAGE residual0[]; };
layout(std430, binding = 6) readonly buffer Residual1 { STORAGE residual1[]; };
layout(std430, binding = 7) readonly buffer Residual2 { STORAGE residual2[]; };
// The input is bound where there is no second input, as always with kUnshuffle > 1.
layout(std430, binding = 8) readonly buffer Second { STORAGE second_data[]; };

// Shared memory is counted in steps of 16 bytes (8 halves), to which matrices must be aligned. Rows of a
// matrix are one step further apart than they are long, so that they fall into different banks.
const uint kStep = 8;
const uint kColumns = RAYMELD_MATRIX_COLUMNS, kRadius = kKernel / 2, kTaps = kKernel * kKernel;
const uint kTileWidth = kColumns + 2 * kRadius, kTilePixels = (kSubgroups * kRows + 2 * kRadius) * kTileWidth;
const uint kPixelSteps = kChannels / kStep, kPixelStride = kPixelSteps + 1;
const uint kWeightSteps = kTaps * kChannels / kStep, kWeightStride = kWeightSteps + 1;
// Once the tile has been read, sums take its place: for each subgroup kM channels of
// a row of pixels, 4 in a step.
const uint kSumStride = kColumns / 4 + 2;
const uint kTileSteps = kTilePixels * kPixelStride, kSumSteps = kSubgroups * kM * kSumStride;
shared uvec4 tile[kTileSteps > kSumSteps ? kTileSteps : kSumSteps];
shared uvec4 block_weights[kOutputs * kM * kWeightStride];

const uint kAcross = kColumns / kN, kPixels = kRows * kAcross;  // matrices of pixels
#define MATRIX_A coopmat<float16_t, gl_ScopeSubgroup, kM, kK, gl_MatrixUseA>
#define MATRIX_B coopmat<float16_t, gl_ScopeSubgroup, kK, kN, gl_MatrixUseB>
#define MATRIX_SUM coopmat<float, gl_ScopeSubgroup, kM, kN, gl_MatrixUseAccumulator>

// Returns 0 outside the image; unsigned wrap-around makes one comparison serve both edges.
float16_t load(uint i, uint y, uint x) {
  bool inside = i < p.channels_in && y < p.height && x < p.width;
  bool second = kSecondInput != 0 && i >= p.channels_first;
  if (second) i -= p.channels_first;
  uint at = address(i / (kUnshuffle * kUnshuffle), kUnshuffle * y + i / kUnshuffle % kUnshuffle,
                    kUnshuffle * x + i % kUnshuffle, p.plane_in, kUnshuffle * p.width);
  at = inside ? at : 0;
  float16_t value = second ? second_data[at] : in_data[at];
  return inside ? value : float16_t(0.0);
}

void share_tile(uint first_channel, uint y0, uint x0) {
  for (uint n = gl_LocalInvocationIndex; n < kTilePixels * kPixelSteps; n += gl_WorkGroupSize.x) {
    uint pixel = n % kTilePixels, step = n / kTilePixels, i = first_channel + step * kStep;
    uint y = y0 + pixel / kTileWidth - kRadius, x = x0 + pixel % kTileWidth - kRadius;
    uvec4 halves;
    [[unroll]] for (uint k = 0; k < 4; ++k)
      halves[k] = packFloat2x16(f16vec2(load(i + 2 * k, y, x), load(i + 2 * k + 1, y, x)));
    tile[pixel * kPixelStride + step] = halves;
  }
}

void share_weights(uint first) {
  for (uint n = gl_LocalInvocationIndex; n < kOutputs * kM * kWeightSteps; n += gl_WorkGroupSize.x)
    block_weights[n / kWeightSteps * kWeightStride + n % kWeightSteps] = weights[first + n];
}

void store(uint o, uint y, uint x, float value) {
  if (o >= p.channels_out || y >= p.height || x >= p.width) return;
  uint at = address(o / (kShuffle * kShuffle), kShuffle * y + o / kShuffle % kShuffle,
                    kShuffle * x + o % kShuffle, p.plane_out, kShuffle * p.width);
  value += bias[(kBorders != 0 ? border_case(y, x, p.height, p.width) * p.channels_out : 0) + o];
  if (kRelu != 0) value = rectified(value);
  if (kResiduals > 0) value += float(residual0[at]);
  if (kResiduals > 1) value += float(residual1[at]);
  if (kResiduals > 2) value += float(residual2[at]);
  out_data[at] = STORAGE(storable(value));
}

void main() {
  uint block = gl_WorkGroupID.z, x0 = gl_WorkGroupID.x * kColumns, y0 = gl_WorkGroupID.y * kSubgroups * kRows;
  uint chunks = (p.channels_in + kChannels - 1) / kChannels, first_row = gl_SubgroupID * kRows;
  MATRIX_SUM sum[kOutputs * kPixels];
  [[unroll]] for (uint n = 0; n < kOutputs * kPixels; ++n) sum[n] = MATRIX_SUM(0.0);
  for (uint chunk = 0; chunk < chunks; ++chunk) {
    barrier();  // all must have read the previous chunk
    share_tile(chunk * kChannels, y0, x0);
    share_weights((block * chunks + chunk) * kOutputs * kM * kWeightSteps);
    barrier();
    for (uint ky = 0; ky < kKernel; ++ky) {
      for (uint kx = 0; kx < kKernel; ++kx) {
        [[unroll]] for (uint step = 0; step < kPixelSteps; step += kK / kStep) {
          MATRIX_A a[kOutputs];
          [[unroll]] for (uint o = 0; o < kOutputs; ++o)
            coopMatLoad(a[o], block_weights,
                        o * kM * kWeightStride + (ky * kKernel + kx) * kPixelSteps + step, kWeightStride,
                        gl_CooperativeMatrixLayoutRowMajor);
          [[unroll]] for (uint n = 0; n < kPixels; ++n) {
            MATRIX_B b;
            uint pixel = (first_row + n / kAcross + ky) * kTileWidth + n % kAcross * kN + kx;
            coopMatLoad(b, tile, pixel * kPixelStride + step, kPixelStride,
                        gl_CooperativeMatrixLayoutColumnMajor);
            [[unroll]] for (uint o = 0; o < kOutputs; ++o)
              sum[o * kPixels + n] = coopMatMulAdd(a[o], b, sum[o * kPixels + n]);
          }
        }
      }
    }
  }
  barrier();
  uint own = gl_SubgroupID * kM * kSumStride;
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
    [[unroll]] for (uint row = 0; row < kRows; ++row) {
      [[unroll]] for (uint n = 0; n < kAcross; ++n)
        coopMatStore(sum[o * kPixels + row * kAcross + n], tile, own + n * kN / 4, kSumStride,
                     gl_CooperativeMatrixLayoutRowMajor);
      subgroupBarrier();
      for (uint n = gl_SubgroupInvocationID; n < kM * kColumns; n += gl_SubgroupSize)
        store((block * kOutputs + o) * kM + n / kColumns, y0 + first_row + row, x0 + n % kColumns,
              uintBitsToFloat(tile[own + n / kColumns * kSumStride + n % kColumns / 4][n % 4]));
      subgroupBarrier();
    }
  }
  count_saturated();
}
