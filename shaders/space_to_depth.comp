// Space to depth by 2 (PyTorch's pixel_unshuffle): out(4c + 2dy + dx, y, x) = in(c, 2y + dy, 2x + dx).
// One invocation for each output element; z is the output channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
layout(push_constant) uniform Push { Shuffle p; };
layout(std430, binding = 1) readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 2) writeonly buffer Output { STORAGE out_data[]; };

void main() {
  uvec3 id = gl_GlobalInvocationID;
  if (id.x >= p.width || id.y >= p.height) return;
  uint c = id.z / 4, dy = id.z / 2 % 2, dx = id.z % 2;
  out_data[address(id.z, id.y, id.x, p.plane, p.width)] =
      in_data[address(c, 2 * id.y + dy, 2 * id.x + dx, p.plane_large, 2 * p.width)];
}
