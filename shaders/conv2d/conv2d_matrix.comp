// Computes the same 2D convolution as conv2d.comp with cooperative matrices: 16-bit factors, 32-bit sums.
// sum(o, pixel) is a matrix product of weights (o, i) and inputs (i, pixel), added up over chunks of
// kChannels input channels and, in each chunk, over the taps.
//
// A workgroup computes kOutputs * kM output channels of kSubgroups * kRows rows of kColumns pixels, and a
// subgroup kRows of these rows; z is the block of output channels. A chunk of the input, with the border that
// the taps reach, is transposed on its way into shared memory: the channels of a pixel lie side by side, so
// that each tap's matrix is only an offset away.
// Weights lie as [block][chunk][kOutputs * kM][kTaps][kChannels], zero where channels end early. All loops
// but that over chunks are unrolled, so that their loads are in flight together.
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
#include "loops.glsl"

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
// An invocation stores so many values of a row at once, 1, 2 or 4; rows and planes must be multiples of it.
layout(constant_id = 14) const uint kRun = 1;

layout(push_constant) uniform Push { Conv2d p; };
layout(std430, binding = 1) readonly buffer Weights { uvec4 weights[]; };
layout(std430, binding = 2) readonly buffer Bias { float bias[]; };
layout(std430, binding = 3) readonly buffer Input { STORAGE in_data[]; };
// Declares a buffer of halves, also as pairs and as fours of them.
#define RUNS(index, access, Block, name)                                                \
  layout(std430, binding = index) access buffer Block { STORAGE name[]; };              \
  layout(std430, binding = index) access buffer Block##Pairs { uint name##_pairs[]; };  \
  layout(std430, binding = index) access buffer Block##Fours { uvec2 name##_fours[]; };
RUNS(4, writeonly, Output, out_data)
// The input is bound in place of residuals that are missing.
RUNS(5, readonly, Residual0, residual0)
RUNS(6, readonly, Residual1, residual1)
RUNS(7, readonly, Residual2, residual2)
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

const uint kLanes = gl_WorkGroupSize.x / kSubgroups;  // lanes of a subgroup
const uint kAcross = kColumns / kN, kPixels = kRows * kAcross;  // matrices of pixels
#define MATRIX_A coopmat<float16_t, gl_ScopeSubgroup, kM, kK, gl_MatrixUseA>
#define MATRIX_B coopmat<float16_t, gl_ScopeSubgroup, kK, kN, gl_MatrixUseB>
#define MATRIX_SUM coopmat<float, gl_ScopeSubgroup, kM, kN, gl_MatrixUseAccumulator>

// Channels are counted so that those of a second input start at a multiple of kStep; weights of the channels
// between the inputs are zero. So the channels of a step are in one input.
uint first_padded() { return (p.channels_first + kStep - 1) / kStep * kStep; }

// An invocation shares at most so many pixels.
const uint kRounds = (kTilePixels + gl_WorkGroupSize.x - 1) / gl_WorkGroupSize.x;

// Shares a step of channels, from channel i of an input that has `count`: zeros where channels end early, and
// for pixels outside the image. Loads take no branch, so that they are in flight together; those of missing
// channels read the last. An invocation's pixels are at `places` of a channel.
#define SHARE_STEP(data, step, i, count, places, inside)                                        \
  uvec4 present;                                                                                \
  [[unroll]] for (uint k = 0; k < 4; ++k)                                                       \
    present[k] = ((i) + 2 * k < (count) ? 0xffffu : 0) |                                        \
                 ((i) + 2 * k + 1 < (count) ? 0xffff0000u : 0);                                 \
  [[unroll]] for (uint round = 0; round < kRounds; ++round) {                                   \
    float16_t halves[kStep];                                                                    \
    [[unroll]] for (uint k = 0; k < kStep; ++k) {                                               \
      uvec3 channel = shuffled(kUnshuffle, min((i) + k, (count) - 1), 0, 0);                    \
      uint first = address(channel.x, channel.y, channel.z, p.plane_in, kUnshuffle * p.width);  \
      halves[k] = data[first + places[round]];                                                  \
    }                                                                                           \
    uvec4 packed;                                                                               \
    [[unroll]] for (uint k = 0; k < 4; ++k)                                                     \
      packed[k] = packFloat2x16(f16vec2(halves[2 * k], halves[2 * k + 1])) & present[k];        \
    uint pixel = round * gl_WorkGroupSize.x + gl_LocalInvocationIndex;                          \
    if ((round + 1) * gl_WorkGroupSize.x <= kTilePixels || pixel < kTilePixels)                 \
      tile[pixel * kPixelStride + step] = inside[round] ? packed : uvec4(0);                    \
  }

void share_tile(uint first_channel, uint y0, uint x0) {
  uint places[kRounds];
  bool inside[kRounds];
  [[unroll]] for (uint round = 0; round < kRounds; ++round) {
    uint pixel = round * gl_WorkGroupSize.x + gl_LocalInvocationIndex;
    uvec2 size = uvec2(p.width, p.height);
    // Unsigned wrap-around serves both edges.
    uvec2 at = uvec2(x0 + pixel % kTileWidth, y0 + pixel / kTileWidth) - kRadius, clamped = min(at, size - 1);
    inside[round] = at == clamped;
    places[round] = kUnshuffle * address(0, kUnshuffle * clamped.y, clamped.x, 0, p.width);
  }
  [[unroll]] for (uint step = 0; step < kPixelSteps; ++step) {
    uint i = first_channel + step * kStep;
    if (kSecondInput != 0 && i >= first_padded()) {
      SHARE_STEP(second_data, step, i - first_padded(), p.channels_in - p.channels_first, places, inside)
    } else {
      SHARE_STEP(in_data, step, i, p.channels_first, places, inside)
    }
  }
}

void share_weights(uint first) {
  const uint kCount = kOutputs * kM * kWeightSteps;
  [[unroll]] for (uint round = 0; round < kCount; round += gl_WorkGroupSize.x) {
    uint n = round + gl_LocalInvocationIndex;
    uvec4 values = weights[first + min(n, kCount - 1)];
    if (round + gl_WorkGroupSize.x <= kCount || n < kCount)
      block_weights[n / kWeightSteps * kWeightStride + n % kWeightSteps] = values;
  }
}

// An invocation stores kStores runs of the kM * kColumns sums of a row of pixels, which shuffling puts into
// rows of kShuffledRow values.
const uint kStores = kM * kColumns / (kLanes * kRun), kShuffledRow = kColumns * kShuffle;

// Adds the halves from `at` on to a run of values.
#define ADD_RUN(name, at, values)                                                             \
  if (kRun == 1) {                                                                            \
    values[0] += float(name[at]);                                                             \
  } else {                                                                                    \
    uvec2 bits = kRun == 2 ? uvec2(name##_pairs[(at) / 2], 0) : name##_fours[(at) / 4];       \
    [[unroll]] for (uint j = 0; j < kRun; ++j)                                                \
      values[j] += float(unpackFloat2x16(bits[j / 2])[j % 2]);                                \
  }

// Stores a run of sums of outputs from o on. The first is `across` values right of pixel x0 in shuffled row
// `rest` of these outputs, which need not start at a channel's first row.
void store(uint o, uint y, uint x0, uint across, uint rest, float values[kRun]) {
  o += rest * kShuffle;
  uint left = kShuffle * x0 + across;
  if (any(greaterThanEqual(uvec3(o, y, left), uvec3(p.channels_out, p.height, kShuffle * p.width)))) return;
  uint at = address(o / (kShuffle * kShuffle), kShuffle * y + o / kShuffle % kShuffle, left, p.plane_out,
                    kShuffle * p.width);
  [[unroll]] for (uint j = 0; j < kRun; ++j) {
    values[j] += bias[o + (left + j) % kShuffle];
    if (kRelu != 0) values[j] = rectified(values[j]);
  }
  if (kResiduals > 0) { ADD_RUN(residual0, at, values) }
  if (kResiduals > 1) { ADD_RUN(residual1, at, values) }
  if (kResiduals > 2) { ADD_RUN(residual2, at, values) }
  [[unroll]] for (uint j = 0; j < kRun; ++j) values[j] = storable(values[j]);
  if (kRun == 1) {
    out_data[at] = STORAGE(values[0]);
  } else {
    uint pairs[2];
    [[unroll]] for (uint j = 0; j < kRun; j += 2)
      pairs[j / 2] = packFloat2x16(f16vec2(values[j], values[j + 1]));
    if (kRun == 2) out_data_pairs[at / 2] = pairs[0];
    if (kRun == 4) out_data_fours[at / 4] = uvec2(pairs[0], pairs[1]);
  }
}

void main() {
  uint block = gl_WorkGroupID.z, x0 = gl_WorkGroupID.x * kColumns, y0 = gl_WorkGroupID.y * kSubgroups * kRows;
  uint channels = first_padded() + p.channels_in - p.channels_first;
  uint chunks = (channels + kChannels - 1) / kChannels, first_row = gl_SubgroupID * kRows;
  MATRIX_SUM sum[kOutputs * kPixels];
  [[unroll]] for (uint n = 0; n < kOutputs * kPixels; ++n) sum[n] = MATRIX_SUM(0.0);
  FOR_EACH(chunk, chunks) {
    barrier();  // all must have read the previous chunk
    share_tile(chunk * kChannels, y0, x0);
    share_weights((block * chunks + chunk) * kOutputs * kM * kWeightSteps);
    barrier();
    [[unroll]] for (uint ky = 0; ky < kKernel; ++ky) {
      [[unroll]] for (uint kx = 0; kx < kKernel; ++kx) {
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
      [[unroll]] for (uint n = 0; n < kStores; ++n) {
        uint first = (n * kLanes + gl_SubgroupInvocationID) * kRun;
        uint across = first % kShuffledRow, rest = first / kShuffledRow;
        float values[kRun];
        if (kShuffle == 1 && kRun == 4) {
          uvec4 sums = tile[own + rest * kSumStride + across / 4];
          [[unroll]] for (uint j = 0; j < kRun; ++j) values[j] = uintBitsToFloat(sums[j]);
        } else {
          [[unroll]] for (uint j = 0; j < kRun; ++j) {
            uint channel = rest * kShuffle + (across + j) % kShuffle, column = (across + j) / kShuffle;
            values[j] = uintBitsToFloat(tile[own + channel * kSumStride + column / 4][column % 4]);
          }
        }
        store((block * kOutputs + o) * kM, y0 + first_row + row, x0, across, rest, values);
      }
      subgroupBarrier();
    }
  }
  count_saturated();
}
