// Computes the same as pointwise_unshuffled.comp on drivers that make vectors of kVector invocations: see
// vector.glsl. An unshuffled pixel is kSide x kSide pixels of the image. The lanes of a vector are pixels
// side by side, which belong to several unshuffled pixels. Each lane sums up its own column of an unshuffled
// pixel, and then lanes are added. An invocation works on two vectors of pixels; y is the block of output
// channels, z the row of unshuffled pixels.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#define VECTOR_PUSH uint digits[4];
#include "memory.glsl"

layout(local_size_x = 32) in;
#include "invocation.glsl"
layout(constant_id = 0) const uint kSide = 4;
layout(constant_id = 1) const uint kChannels = 27;  // channels of the image
layout(constant_id = 2) const uint kOutputs = 6;
layout(constant_id = 3) const uint kRelu = 0;
layout(constant_id = 4) const uint kVector = 8;  // a multiple of kSide
const uint kVectors = 2, kPixels = kVector / kSide;
const uint kOrder = 2;
layout(push_constant) uniform Push {
  Floats weights;
  Floats bias;
  Floats source;
  Floats target;
  PointwiseUnshuffled p;
  VECTOR_PUSH
};
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"

void main() {
  uint block = uniform_number(gl_WorkGroupID.y), row = uniform_number(gl_WorkGroupID.z);
  uint left = kVectors * first_of_vector().x;
  Quads w = Quads(uint64_t(weights) + 4ul * (block * kChannels * kSide * kOutputs * kVector));
  vec2 sum[kOutputs];
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) sum[o] = vec2(0.0);
  [[unroll]] for (uint c = 0; c < kChannels; ++c) {
    [[unroll]] for (uint y = 0; y < kSide; ++y) {
      Floats pixels = Floats(uint64_t(source) + 4ul * address(c, kSide * row + y, left, p.plane, p.width));
      vec2 value = vec2(read_vector(pixels, 0), read_vector(pixels, kVector));
      [[unroll]] for (uint o = 0; o < kOutputs; ++o)
        sum[o] = fma(vec2(read_weights(w, ((c * kSide + y) * kOutputs + o) * kVector)), value, sum[o]);
    }
    if (c % kOrder == kOrder - 1) {
      vec2 all = vec2(0.0);
      [[unroll]] for (uint o = 0; o < kOutputs; ++o) all += sum[o];
      keep_order(all.x + all.y);
    }
  }
  if (end_order()) return;
  uint lane = gl_SubgroupInvocationID, columns = p.width / kSide, pixel = left / kSide + lane;
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
    [[unroll]] for (uint step = 1; step < kSide; step *= 2)
      sum[o] += vec2(subgroupShuffle(sum[o].x, lane ^ step), subgroupShuffle(sum[o].y, lane ^ step));
    uint from = lane * kSide % kVector;
    float low = subgroupShuffle(sum[o].x, from), high = subgroupShuffle(sum[o].y, from);
    uint channel = block * kOutputs + o;
    float value = (lane < kPixels ? low : high) + bias.v[channel];
    if (kRelu != 0) value = rectified(value);
    if (lane < kVectors * kPixels && pixel < columns && channel < p.channels_out)
      target.v[address(channel, row, pixel, p.plane_out, columns)] = value;
  }
}
