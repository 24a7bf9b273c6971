// Writes the demodulated radiance of HRLS without its fireflies, x = radiance / (albedo + floor), as
// log(1 + compress * x) / compress. Each invocation computes a strip of pixels, as in demodulate.comp.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, color) ADDRESS(Values, albedo) ADDRESS(Values, target)
  Light p;
};
BUFFER(1, readonly, Color, STORAGE, color)
BUFFER(2, readonly, Albedo, STORAGE, albedo)
BUFFER(3, writeonly, Target, STORAGE, target)
#include "strip.glsl"

vec3 color_at(ivec2 at) {
  vec3 rgb;
  for (uint c = 0; c < 3; ++c)
    rgb[c] = to_linear(float(color.v[address(c, at.y, at.x, p.plane, p.width)]), p.log_transfer);
  return rgb;
}

#include "fireflies.glsl"

void main() {
  uvec2 id = global_invocation_id().xy;
  Strip strip = strip_at(id, uvec2(p.width, p.height));
  Neighbours near = neighbours_of(id, ivec2(p.width, p.height) - 1);
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    vec3 own = near.own[k] * firefly_limit(near.luminances, k);
    [[unroll]] for (uint c = 0; c < 3; ++c) {
      uint element = address(c, strip.pixels[k].y, strip.pixels[k].x, p.plane, p.width);
      float x = own[c] / (float(albedo.v[element]) + RAYMELD_ALBEDO_FLOOR);
      float value = log(1.0 + RAYMELD_COMPRESS * x) / RAYMELD_COMPRESS;
      if (strip.wanted[k]) target.v[element] = STORAGE(storable(value));
    }
  }
  count_saturated();
}
