// Second of three steps of a convolution: at each position, products(o, tile) = sum over i of weight(o, i) * transformed(i,
// tile), of kChannels input channels; with kAdd on top of the products of the channels before.
// An invocation makes kOutputs output channels of one tile, with kPaired of two that are kVector apart; y is the block of
// output channels, z the position.
//
// Nothing branches and all loops unroll: a CPU driver then reads a weight, whose address is the same for all lanes, once.
// Compilers would also move all loads to the front, and spill; an own product stored after every kOrder channels, which
// later loads might depend on for all they know, keeps the order.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#include "memory.glsl"
#include "winograd.glsl"

layout(local_size_x_id = 6) in;
#include "invocation.glsl"
layout(constant_id = 1) const uint kChannels = 64;
layout(constant_id = 2) const uint kOutputs = 16;
layout(constant_id = 3) const uint kAdd = 0;
layout(constant_id = 4) const uint kOrder = 8;  // 0: never
layout(constant_id = 5) const uint kVector = 0;
layout(constant_id = 7) const uint kPaired = 0;
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Floats weights;
  Floats transformed;
  Floats products;
  WinogradMultiply p;
};
#else
layout(push_constant) uniform Push {
  Floats weights;
  WinogradMultiply p;
};
layout(std430, binding = 1) readonly buffer Transformed { float v[]; } transformed;
layout(std430, binding = 2) buffer Products { float v[]; } products;
#endif
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"

void main() {
  uint block = uniform_number(gl_WorkGroupID.y), position = uniform_number(gl_WorkGroupID.z);
  uint weight = position * p.weights_stride + (block * p.channels_in + p.first_channel) * kOutputs;
  uint first = first_of_vector().x * (1 + kPaired);  // tile
  uint from = element(position, p.first_channel, first, p.transformed_stride, p.channels_in);
  uint before = element(position, block * kOutputs, first, p.products_stride, p.blocks * kOutputs);
  uint to = element(position, block * kOutputs, global_invocation_id().x, p.products_stride, p.blocks * kOutputs);
  Floats w = Floats(uint64_t(weights) + 4ul * weight);
#ifdef DATA_BY_ADDRESS
  Floats inputs = Floats(uint64_t(transformed) + 4ul * from), sums = Floats(uint64_t(products) + 4ul * before);
  Floats results = Floats(uint64_t(products) + 4ul * to);
  Pairs pairs = Pairs(uint64_t(sums) + 8ul * gl_SubgroupInvocationID);
#define INPUT(at) vec2(read_vector(inputs, at), kPaired != 0 ? read_vector(inputs, at + kVector) : 0.0)
#define SUM(at) (kPaired != 0 ? floats(pairs.v[(at) / 2]) : vec2(read_vector(sums, at), 0.0))
#else
#define INPUT(at) vec2(transformed.v[from + at], 0.0)
#define SUM(at) vec2(products.v[before + at], 0.0)
#endif
  vec2 sum[kOutputs];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = kAdd != 0 ? SUM(o * kLanes) : vec2(0.0);
  [[unroll]] for (uint i = 0; i < kChannels; ++i) {
    vec2 value = INPUT(i * kLanes);
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = fma(vec2(w.v[i * kOutputs + o]), value, sum[o]);
    if (kOrder > 0 && (i + 1) % kOrder == 0 && i + 1 < kChannels) {
      vec2 all = vec2(0.0);
      [[unroll]] for (uint o = 0; o < kOutputs; ++o) all += sum[o];
      if (kPaired != 0) {
        keep_order(all.x + all.y);
      } else {
#ifdef DATA_BY_ADDRESS
        results.v[0] = all.x;
#else
        products.v[to] = all.x;
#endif
      }
    }
  }
  if (kPaired != 0 && kOrder > 0 && end_order()) return;
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
#ifdef DATA_BY_ADDRESS
    if (kPaired != 0) {
      pairs.v[o * kLanes / 2] = pair(sum[o]);
    } else {
      results.v[o * kLanes] = sum[o].x;
    }
#else
    products.v[to + o * kLanes] = sum[o].x;
#endif
  }
}
