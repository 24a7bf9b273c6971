// Writes the differences between each element and the next one along x and, p.channels channels later, along
// y. They are 0 in the last column and the last row. Each invocation computes one element; z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, source) ADDRESS(Values, target)
  Gradients p;
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, writeonly, Target, STORAGE, target)

float source_at(uint c, uint y, uint x) { return float(source.v[address(c, y, x, p.plane, p.width)]); }

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= p.width || id.y >= p.height) return;
  float own = source_at(id.z, id.y, id.x);
  float along_x = source_at(id.z, id.y, min(id.x + 1, p.width - 1)) - own;
  float along_y = source_at(id.z, min(id.y + 1, p.height - 1), id.x) - own;
  target.v[address(id.z, id.y, id.x, p.plane, p.width)] = STORAGE(storable(along_x));
  target.v[address(id.z + p.channels, id.y, id.x, p.plane, p.width)] = STORAGE(storable(along_y));
  count_saturated();
}
