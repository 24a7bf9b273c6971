// Computes a 1x1 convolution of kChannels input channels: all of them, or a part where they are too many for
// one dispatch. Sums are kept from one part to the next. The first part starts with the bias; the last part
// applies ReLU and adds residuals as in conv2d.comp. Each invocation computes kOutputs output channels of one
// pixel; y is the block of output channels.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#include "memory.glsl"

layout(local_size_x = 64) in;
#include "invocation.glsl"
#include "pointwise.glsl"

void main() {
  uint block = gl_WorkGroupID.y, in_band = global_invocation_id().x, pixel = p.first_pixel + in_band;
  uint sum_at = sum_address(block, in_band);
  Floats w = block_weights(block), b = block_bias(block);
  float sum[kOutputs];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = kFirst != 0 ? b.v[o] : sums.v[sum_at + o * kLanes];
  [[unroll]] for (uint i = 0; i < kChannels; ++i) {
    float value = float(source.v[i * p.plane_in + pixel]);
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = fma(w.v[i * kOutputs + o], value, sum[o]);
  }
  store_sums(block, pixel, sum_at, sum);
  count_saturated();
}
