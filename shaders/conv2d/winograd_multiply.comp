// Computes the second of three steps of a Winograd convolution: at each position, products(o, tile) = sum
// over i of weight(o, i) * transformed(i, tile), over kChannels input channels. With kAdd it continues the
// sum of earlier channels. Each invocation computes kOutputs output channels of one tile; y is the block of
// output channels, z the position.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#include "memory.glsl"
#include "winograd.glsl"

layout(local_size_x = 64) in;
#include "invocation.glsl"
layout(constant_id = 1) const uint kChannels = 64;
layout(constant_id = 2) const uint kOutputs = 16;
layout(constant_id = 3) const uint kAdd = 0;
layout(push_constant) uniform Push {
  Floats weights;
  ADDRESS(Floats, transformed)
  ADDRESS(Floats, products)
  WinogradMultiply p;
};
BUFFER(1, readonly, Transformed, float, transformed)
BUFFER(2, , Products, float, products)

void main() {
  uint block = gl_WorkGroupID.y, position = gl_WorkGroupID.z, tile = global_invocation_id().x;
  uint weight = position * p.weights_stride + (block * p.channels_in + p.first_channel) * kOutputs;
  uint from = element(position, p.first_channel, tile, p.transformed_stride, p.channels_in);
  uint to = element(position, block * kOutputs, tile, p.products_stride, p.blocks * kOutputs);
  Floats w = Floats(uint64_t(weights) + 4ul * weight);
  float sum[kOutputs];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = kAdd != 0 ? products.v[to + o * kLanes] : 0.0;
  [[unroll]] for (uint i = 0; i < kChannels; ++i) {
    float value = transformed.v[from + i * kLanes];
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = fma(w.v[i * kOutputs + o], value, sum[o]);
  }
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) products.v[to + o * kLanes] = sum[o];
}
