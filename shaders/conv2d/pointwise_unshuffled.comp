// Computes a 1x1 convolution of space_to_depth() by kSide, with ReLU or without. An unshuffled pixel is kSide
// x kSide pixels of the image. Each of its columns is summed up on its own, and then the columns are added in
// pairs. pointwise_unshuffled_vectors.comp does so too, and gives the same bits. Each invocation computes
// kOutputs output channels of one unshuffled pixel; z is the block of output channels.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#include "memory.glsl"

layout(local_size_x = 64) in;
#include "invocation.glsl"
layout(constant_id = 0) const uint kSide = 4;
layout(constant_id = 1) const uint kChannels = 27;  // channels of the image
layout(constant_id = 2) const uint kOutputs = 6;
layout(constant_id = 3) const uint kRelu = 0;
layout(constant_id = 4) const uint kWeightColumns = 4;  // a multiple of kSide
layout(push_constant) uniform Push {
  Floats weights;
  Floats bias;
  ADDRESS(Values, source)
  ADDRESS(Values, target)
  PointwiseUnshuffled p;
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, writeonly, Target, STORAGE, target)

void main() {
  uvec2 pixel = global_invocation_id().xy;
  uint block = gl_WorkGroupID.z, columns = p.width / kSide;
  if (pixel.x >= columns || pixel.y >= p.rows) return;
  uint from = address(0, kSide * pixel.y, kSide * pixel.x, p.plane, p.width);
  uint weight = block * kChannels * kSide * kOutputs * kWeightColumns;
  float sum[kOutputs][kSide];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
    [[unroll]] for (uint x = 0; x < kSide; ++x) sum[o][x] = 0.0;
  }
  for (uint c = 0; c < kChannels; ++c) {
    [[unroll]] for (uint y = 0; y < kSide; ++y) {
      float value[kSide];
      [[unroll]] for (uint x = 0; x < kSide; ++x)
        value[x] = float(source.v[from + address(c, y, x, p.plane, p.width)]);
      [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
        [[unroll]] for (uint x = 0; x < kSide; ++x)
          sum[o][x] = fma(weights.v[weight + x], value[x], sum[o][x]);
        weight += kWeightColumns;
      }
    }
  }
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
    [[unroll]] for (uint step = 1; step < kSide; step *= 2) {
      [[unroll]] for (uint x = 0; x < kSide; x += 2 * step) sum[o][x] += sum[o][x + step];
    }
    uint channel = block * kOutputs + o;
    float value = sum[o][0] + bias.v[channel];
    if (kRelu != 0) value = rectified(value);
    if (channel < p.channels_out)
      target.v[address(channel, pixel.y, pixel.x, p.plane_out, columns)] = STORAGE(storable(value));
  }
  count_saturated();
}
