// Computes the variance of an encoded color, encoded likewise: see variance.comp. Each invocation computes a
// pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, color) ADDRESS(Values, target)
  ColorVariance p;
};
BUFFER(1, readonly, Color, STORAGE, color)
BUFFER(2, writeonly, Target, STORAGE, target)

vec3 color_at(ivec2 pixel) {
  uvec2 at = uvec2(clamp(pixel, ivec2(0), ivec2(p.frame_width, p.frame_height) - 1));
  vec3 result;
  [[unroll]] for (uint c = 0; c < 3; ++c)
    result[c] = to_linear(float(color.v[address(c, at.y, at.x, p.plane, p.width)]), p.log_transfer);
  return result;
}
#include "variance.glsl"

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  vec3 variance = variance_at(ivec2(min(id, uvec2(p.frame_width, p.frame_height) - 1)));
  [[unroll]] for (uint c = 0; c < 3; ++c) {
    float value = to_network(min(variance[c], p.clip), p.log_transfer);
    target.v[address(c, id.y, id.x, p.plane, p.width)] = STORAGE(storable(value));
  }
  count_saturated();
}
