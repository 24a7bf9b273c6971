// Writes the demodulated radiance of LRHS, x = radiance / (albedo + floor), as log(1 + compress * x) /
// compress, where the albedo is the mean over the covered x covered pixels of HRLS from the first one in the
// cell on.
// Each invocation computes one pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, lrhs) ADDRESS(Values, albedo) ADDRESS(Values, target)
  CellLight p;
};
BUFFER(1, readonly, Lrhs, STORAGE, lrhs)
BUFFER(2, readonly, Albedo, STORAGE, albedo)
BUFFER(3, writeonly, Target, STORAGE, target)

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  vec3 mean = vec3(0.0);
  for (uint dy = 0; dy < p.covered; ++dy) {
    for (uint dx = 0; dx < p.covered; ++dx) {
      uint at = address(0, p.scale * id.y + dy, p.scale * id.x + dx, p.plane_large, p.scale * p.width);
      mean += vec3(albedo.v[at], albedo.v[at + p.plane_large], albedo.v[at + 2 * p.plane_large]);
    }
  }
  mean /= float(p.covered * p.covered);
  for (uint c = 0; c < 3; ++c) {
    uint element = address(c, id.y, id.x, p.plane, p.width);
    float x = to_linear(float(lrhs.v[element]), p.log_transfer) / (mean[c] + RAYMELD_ALBEDO_FLOOR);
    target.v[element] = STORAGE(storable(log(1.0 + RAYMELD_COMPRESS * x) / RAYMELD_COMPRESS));
  }
  count_saturated();
}
