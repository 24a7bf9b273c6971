// Writes max(0, whole - part), both decoded, encoded again. Each invocation computes one element; z is the
// channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, whole) ADDRESS(Values, part) ADDRESS(Values, target)
  Remainder p;
};
BUFFER(1, readonly, Whole, STORAGE, whole)
BUFFER(2, readonly, Part, STORAGE, part)
BUFFER(3, writeonly, Target, STORAGE, target)

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= p.width || id.y >= p.height) return;
  uint at = address(id.z, id.y, id.x, p.plane, p.width);
  float all = to_linear(float(whole.v[at]), p.log_transfer);
  float rest = max(all - to_linear(float(part.v[at]), p.log_transfer), 0.0);
  target.v[at] = STORAGE(storable(to_network(rest, p.log_transfer)));
  count_saturated();
}
