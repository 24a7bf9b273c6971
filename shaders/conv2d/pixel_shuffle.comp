// Computes PyTorch's pixel_shuffle by r: out(c, r y + dy, r x + dx) = in(r r c + r dy + dx, y, x).
// Each invocation computes one output element; z is the output channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(constant_id = 0) const uint r = 2;
layout(push_constant) uniform Push { Shuffle p; };
layout(std430, binding = 1) readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 2) writeonly buffer Output { STORAGE out_data[]; };

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= r * p.width || id.y >= r * p.height) return;
  uint c = r * r * id.z + r * (id.y % r) + id.x % r;
  out_data[address(id.z, id.y, id.x, p.plane_large, r * p.width)] =
      in_data[address(c, id.y / r, id.x / r, p.plane, p.width)];
}
