// Computes the same as pointwise.comp on drivers that make vectors of kVector invocations: see vector.glsl.
// Nothing branches before the stores and all loops unroll, so that a weight, whose address is the same for
// all lanes, is read once. A sum that is stored after every kOrder channels keeps the loads in order: see
// vector.glsl.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#define VECTOR_PUSH uint digits[4];
#include "memory.glsl"

layout(local_size_x = 64) in;
#include "invocation.glsl"
#include "pointwise.glsl"
layout(constant_id = 6) const uint kOrder = 8;  // 0: never
layout(constant_id = 7) const uint kVector = 8;
#include "uniform.glsl"
#include "vector.glsl"

float read_source(uint64_t first) {
#ifdef STORAGE_F16
  return float(Values(first).v[gl_SubgroupInvocationID]);
#else
  return read_vector(Floats(first), 0);
#endif
}

void main() {
  uint block = uniform_number(gl_WorkGroupID.y), in_band = global_invocation_id().x,
       first = first_of_vector().x;
  uint sum_at = sum_address(block, in_band);
  Floats w = block_weights(block), b = block_bias(block);
  Floats before = Floats(uint64_t(sums) + 4ul * sum_address(block, first));
  uint64_t next = uint64_t(source) + uint64_t(p.first_pixel + first) * STORAGE_BYTES;
  float sum[kOutputs];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o)
    sum[o] = kFirst != 0 ? b.v[o] : read_vector(before, o * kLanes);
  [[unroll]] for (uint i = 0; i < kChannels; ++i) {
    float value = read_source(next);
    next += uint64_t(p.plane_in) * STORAGE_BYTES;
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = fma(w.v[i * kOutputs + o], value, sum[o]);
    if (kOrder > 0 && (i + 1) % kOrder == 0 && i + 1 < kChannels) {
      float all = 0.0;
      [[unroll]] for (uint o = 0; o < kOutputs; ++o) all += sum[o];
      sums.v[sum_at] = all;
    }
  }
  store_sums(block, p.first_pixel + in_band, sum_at, sum);
  count_saturated();
}
