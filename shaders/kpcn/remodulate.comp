// Multiplies filtered demodulated radiance by albedo + floor, adds the rest of the radiance, and encodes the
// result as the network reads radiance.
// Each invocation computes a strip of elements, as in encode.comp; z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, demodulated) ADDRESS(Values, albedo) ADDRESS(Values, rest) ADDRESS(Values, target)
  Remodulate p;
};
BUFFER(1, readonly, Demodulated, STORAGE, demodulated)
BUFFER(2, readonly, Albedo, STORAGE, albedo)
BUFFER(3, readonly, Rest, STORAGE, rest)
BUFFER(4, writeonly, Target, STORAGE, target)
#include "strip.glsl"

void main() {
  uvec3 id = global_invocation_id();
  Strip strip = strip_at(id.xy, uvec2(p.width, p.height));
  uint at[kStrip];
  [[unroll]] for (uint k = 0; k < kStrip; ++k)
    at[k] = address(id.z, strip.pixels[k].y, strip.pixels[k].x, p.plane, p.width);
  float values[kStrip];
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    float linear = (exp(RAYMELD_COMPRESS * float(demodulated.v[at[k]])) - 1.0) / RAYMELD_COMPRESS;
    linear *= float(albedo.v[at[k]]) + RAYMELD_ALBEDO_FLOOR;
    linear += to_linear(float(rest.v[at[k]]), p.log_transfer);
    values[k] = to_network(linear, p.log_transfer);
  }
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    if (strip.wanted[k]) target.v[at[k]] = STORAGE(storable(values[k]));
  }
  count_saturated();
}
