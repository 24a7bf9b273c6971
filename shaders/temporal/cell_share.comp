// Writes the share of LRHS in the light of its level: certainty / (certainty + scale^2 n), where n is the
// mean of the samples of HRLS in the cell, given by their binary logarithm. Each invocation computes a pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, samples) ADDRESS(Values, target)
  CellShare p;
};
BUFFER(1, readonly, Samples, STORAGE, samples)
BUFFER(2, writeonly, Target, STORAGE, target)

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  float sum = 0.0;
  for (uint i = 0; i < p.scale * p.scale; ++i) {
    uvec2 at = p.scale * id + uvec2(i % p.scale, i / p.scale);
    sum += exp2(float(samples.v[address(0, at.y, at.x, p.plane_large, p.scale * p.width)]));
  }
  target.v[address(0, id.y, id.x, 0, p.width)] = STORAGE(storable(p.certainty / (p.certainty + sum)));
  count_saturated();
}
