// Filtered light with the albedo again, as the network reads radiance. One invocation for each element; z is the channel.
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
#include "left_out.glsl"

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= p.width || id.y >= p.height || is_left_out(id.xy)) return;
  uint at = address(id.z, id.y, id.x, p.plane, p.width);
  float linear = (exp(RAYMELD_COMPRESS * float(light.v[at])) - 1.0) / RAYMELD_COMPRESS;
  float value = to_network(linear * (float(albedo.v[at]) + RAYMELD_ALBEDO_FLOOR), p.log_transfer);
  target.v[at] = STORAGE(storable(value));
}
