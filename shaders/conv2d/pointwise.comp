// 1x1 convolution of kChannels input channels: all of them, or a part where there are too many for one dispatch; sums of
// the parts before are kept in between. The last part adds bias, ReLU and residuals as in conv2d.comp. An invocation
// makes kOutputs output channels of one pixel; y is the block of output channels.
//
// Nothing branches and all loops unroll, and kOrder orders: see winograd_multiply.comp.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#include "memory.glsl"

layout(local_size_x = 64) in;
#include "invocation.glsl"
const uint kLanes = RAYMELD_LANES;  // sums of neighbouring pixels lie side by side
layout(constant_id = 0) const uint kChannels = 64;
layout(constant_id = 1) const uint kOutputs = 16;
layout(constant_id = 2) const uint kOrder = 8;
layout(constant_id = 3) const uint kFirst = 1;
layout(constant_id = 4) const uint kLast = 1;
layout(constant_id = 5) const uint kRelu = 0;
layout(constant_id = 6) const uint kResiduals = 0;
layout(constant_id = 7) const uint kVector = 0;
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Floats weights;
  Floats bias;
  Values source;
  Floats sums;
  Values target;
  Values residual0, residual1, residual2;
  Pointwise p;
};
#else
layout(push_constant) uniform Push {
  Floats weights;
  Floats bias;
  Pointwise p;
};
layout(std430, binding = 1) readonly buffer Source { STORAGE v[]; } source;
layout(std430, binding = 2) buffer Sums { float v[]; } sums;
layout(std430, binding = 3) writeonly buffer Target { STORAGE v[]; } target;
// Bound to the source where there are fewer residuals.
layout(std430, binding = 4) readonly buffer Residual0 { STORAGE v[]; } residual0;
layout(std430, binding = 5) readonly buffer Residual1 { STORAGE v[]; } residual1;
layout(std430, binding = 6) readonly buffer Residual2 { STORAGE v[]; } residual2;
#endif
#include "uniform.glsl"
#include "vector.glsl"

void store(uint at, float value, bool inside) {
  if (kRelu != 0) value = rectified(value);
  if (kResiduals > 0) value += float(residual0.v[at]);
  if (kResiduals > 1) value += float(residual1.v[at]);
  if (kResiduals > 2) value += float(residual2.v[at]);
  // A plane's padding takes what lies beyond the last pixel.
  target.v[at] = STORAGE(storable(inside ? value : 0.0));
}

// Of an invocation's first output channel.
uint sum_address(uint block, uint in_band) {
  return (in_band / kLanes * p.blocks + block) * kOutputs * kLanes + in_band % kLanes;
}

void main() {
  uint block = uniform_number(gl_WorkGroupID.y), in_band = global_invocation_id().x;
  uint pixel = p.first_pixel + in_band;
  bool inside = pixel < p.pixels;
  uint first = first_of_vector().x;  // in the band
  uint sum_at = sum_address(block, in_band);
  Floats w = Floats(uint64_t(weights) + 4ul * ((block * p.channels_in + p.first_channel) * kOutputs));
  Floats b = Floats(uint64_t(bias) + 4ul * (block * kOutputs));
#ifdef DATA_BY_ADDRESS
  const uint64_t step = uint64_t(p.plane) * STORAGE_BYTES;
  uint64_t next = uint64_t(source) + uint64_t(kVector == 0 ? pixel : p.first_pixel + first) * STORAGE_BYTES;
  Floats before = Floats(uint64_t(sums) + 4ul * sum_address(block, first));
#define SUM(at) read_vector(before, at)
#else
#define SUM(at) sums.v[sum_at + at]
#endif
  float sum[kOutputs];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = kFirst != 0 ? b.v[o] : SUM(o * kLanes);
  [[unroll]] for (uint i = 0; i < kChannels; ++i) {
#ifdef DATA_BY_ADDRESS
#ifdef STORAGE_F16
    float value = float(Values(next).v[0]);  // no vectors
#else
    float value = read_vector(Floats(next), 0);
#endif
    next += step;
#else
    float value = float(source.v[i * p.plane + pixel]);
#endif
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = fma(w.v[i * kOutputs + o], value, sum[o]);
    if (kOrder > 0 && (i + 1) % kOrder == 0 && i + 1 < kChannels) {
      float all = 0.0;
      [[unroll]] for (uint o = 0; o < kOutputs; ++o) all += sum[o];
      sums.v[sum_at] = all;
    }
  }
  if (kLast == 0) {
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sums.v[sum_at + o * kLanes] = sum[o];
  } else {
    uint to = block * kOutputs * p.plane + pixel;
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
      if (block * kOutputs + o < p.channels_out) store(to + o * p.plane, sum[o], inside);
    }
  }
}
