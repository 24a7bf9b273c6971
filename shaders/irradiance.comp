// LRHS without the albedo of HRLS: to_network(to_linear(lrhs) / (albedo + floor)). One invocation for each element;
// z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "transfer.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
layout(push_constant) uniform Push { Irradiance p; };
layout(std430, binding = 1) readonly buffer Lrhs { STORAGE lrhs[]; };
layout(std430, binding = 2) readonly buffer Albedo { STORAGE albedo[]; };
layout(std430, binding = 3) writeonly buffer Output { STORAGE out_data[]; };

float albedo_at(uint c, uint y, uint x) { return float(albedo[address(c, y, x, p.plane_large, p.scale * p.width)]); }

void main() {
  uvec3 id = gl_GlobalInvocationID;
  if (id.x >= p.width || id.y >= p.height) return;
  uvec2 corner = p.scale * id.xy;
  float own = albedo_at(id.z, corner.y, corner.x);
  if (p.centered != 0) {
    own = 0.0;
    for (uint dy = 0; dy < p.scale; ++dy) {
      for (uint dx = 0; dx < p.scale; ++dx) own += albedo_at(id.z, corner.y + dy, corner.x + dx);
    }
    own /= float(p.scale * p.scale);
  }
  uint at = address(id.z, id.y, id.x, p.plane, p.width);
  float light = to_linear(float(lrhs[at]), p.log_transfer) / (own + RAYMELD_ALBEDO_FLOOR);
  out_data[at] = STORAGE(storable(to_network(light, p.log_transfer)));
}
