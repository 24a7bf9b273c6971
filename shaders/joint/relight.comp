// Filtered light with the albedo again, as the network reads radiance. One invocation for a strip of elements, as in encode.comp; z is
// the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Values light, albedo, target;
  Relight p;
};
#else
layout(push_constant) uniform Push { Relight p; };
layout(std430, binding = 1) readonly buffer Light { STORAGE v[]; } light;
layout(std430, binding = 2) readonly buffer Albedo { STORAGE v[]; } albedo;
layout(std430, binding = 3) writeonly buffer Target { STORAGE v[]; } target;
#endif
#include "strip.glsl"

void main() {
  uvec3 id = global_invocation_id();
  Strip strip = strip_at(id.xy, uvec2(p.width, p.height));
  uint at[kStrip];
  [[unroll]] for (uint k = 0; k < kStrip; ++k)
    at[k] = address(id.z, strip.pixels[k].y, strip.pixels[k].x, p.plane, p.width);
  float values[kStrip];
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    float linear = (exp(RAYMELD_COMPRESS * float(light.v[at[k]])) - 1.0) / RAYMELD_COMPRESS;
    values[k] = to_network(linear * (float(albedo.v[at[k]]) + RAYMELD_ALBEDO_FLOOR), p.log_transfer);
  }
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    if (strip.wanted[k]) target.v[at[k]] = STORAGE(storable(values[k]));
  }
}
