// Computes the same as winograd_multiply.comp on drivers that make vectors of kVector invocations: see
// vector.glsl. With kPaired an invocation computes the products of two tiles that are kVector apart.
//
// Nothing branches and all loops unroll, so that a weight, whose address is the same for all lanes, is read
// once. A sum that is stored after every kOrder channels keeps the loads in order: see vector.glsl.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#define VECTOR_PUSH uint digits[4];
#include "memory.glsl"
#include "winograd.glsl"

layout(local_size_x_id = 6) in;
#include "invocation.glsl"
layout(constant_id = 1) const uint kChannels = 64;
layout(constant_id = 2) const uint kOutputs = 16;
layout(constant_id = 3) const uint kAdd = 0;
layout(constant_id = 4) const uint kOrder = 8;  // 0: never
layout(constant_id = 5) const uint kVector = 8;
layout(constant_id = 7) const uint kPaired = 0;
layout(push_constant) uniform Push {
  Floats weights;
  Floats transformed;
  Floats products;
  WinogradMultiply p;
  VECTOR_PUSH
};
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"

void main() {
  uint block = uniform_number(gl_WorkGroupID.y), position = uniform_number(gl_WorkGroupID.z);
  uint weight = position * p.weights_stride + (block * p.channels_in + p.first_channel) * kOutputs;
  uint first = first_of_vector().x * (1 + kPaired), tile = global_invocation_id().x;
  uint channels_out = p.blocks * kOutputs;
  uint from = element(position, p.first_channel, first, p.transformed_stride, p.channels_in);
  Floats w = Floats(uint64_t(weights) + 4ul * weight), inputs = Floats(uint64_t(transformed) + 4ul * from);
  Floats sums = Floats(uint64_t(products) +
                       4ul * element(position, block * kOutputs, first, p.products_stride, channels_out));
  Floats results = Floats(uint64_t(products) +
                          4ul * element(position, block * kOutputs, tile, p.products_stride, channels_out));
  Pairs pairs = Pairs(uint64_t(sums) + 8ul * gl_SubgroupInvocationID);
  vec2 sum[kOutputs];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
    sum[o] = vec2(0.0);
    if (kAdd != 0)
      sum[o] = kPaired != 0 ? floats(pairs.v[o * kLanes / 2]) : vec2(read_vector(sums, o * kLanes), 0.0);
  }
  [[unroll]] for (uint i = 0; i < kChannels; ++i) {
    vec2 value =
        vec2(read_vector(inputs, i * kLanes), kPaired != 0 ? read_vector(inputs, i * kLanes + kVector) : 0.0);
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = fma(vec2(w.v[i * kOutputs + o]), value, sum[o]);
    if (kOrder > 0 && (i + 1) % kOrder == 0 && i + 1 < kChannels) {
      vec2 all = vec2(0.0);
      [[unroll]] for (uint o = 0; o < kOutputs; ++o) all += sum[o];
      if (kPaired != 0) {
        keep_order(all.x + all.y);
      } else {
        results.v[0] = all.x;
      }
    }
  }
  if (kPaired != 0 && kOrder > 0 && end_order()) return;
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
    if (kPaired != 0) {
      pairs.v[o * kLanes / 2] = pair(sum[o]);
    } else {
      results.v[o * kLanes] = sum[o].x;
    }
  }
}
