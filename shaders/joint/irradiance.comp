// Demodulates LRHS by the albedo of HRLS, to_network(to_linear(lrhs) / (albedo + floor)), and writes the mean
// of 3x3 such pixels, edges replicated, weighted by a binomial kernel and by how alike their albedo and
// normal are. Each invocation computes one pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, lrhs) ADDRESS(Values, albedo) ADDRESS(Values, normal) ADDRESS(Values, target)
  Irradiance p;
};
BUFFER(1, readonly, Lrhs, STORAGE, lrhs)
BUFFER(2, readonly, Albedo, STORAGE, albedo)
BUFFER(3, readonly, Normal, STORAGE, normal)
BUFFER(4, writeonly, Target, STORAGE, target)
#include "guides.glsl"

Surface surface_of(uvec2 pixel) {
  return surface_of(address(0, pixel.y, pixel.x, p.plane_large, p.scale * p.width), p.plane_large);
}

// Returns the surface that HRLS shows at a pixel of LRHS: the top-left one of its scale x scale pixels
// or, with p.centered, their mean.
Surface surface_at(uvec2 at) {
  uvec2 corner = p.scale * at;
  if (p.centered == 0) return surface_of(corner);
  Surface mean = Surface(vec3(0.0), vec3(0.0));
  for (uint dy = 0; dy < p.scale; ++dy) {
    for (uint dx = 0; dx < p.scale; ++dx) {
      Surface one = surface_of(corner + uvec2(dx, dy));
      mean.albedo += one.albedo;
      mean.normal += one.normal;
    }
  }
  float count = float(p.scale * p.scale);
  return Surface(mean.albedo / count, mean.normal / count);
}

float light_at(uint c, uvec2 at, float own) {
  float light = to_linear(float(lrhs.v[address(c, at.y, at.x, p.plane, p.width)]), p.log_transfer);
  return to_network(light / (own + RAYMELD_ALBEDO_FLOOR), p.log_transfer);
}

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  Surface own = surface_at(id);
  vec3 sum = vec3(0.0);
  float weights = 0.0;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      uvec2 tap = uvec2(clamp(ivec2(id) + ivec2(dx, dy), ivec2(0), ivec2(p.width, p.height) - 1));
      Surface near = surface_at(tap);
      float distance =
          squared_distance(near, own, 1.0 / RAYMELD_ALBEDO_WIDTH, 1.0 / RAYMELD_NORMAL_WIDTH);
      float weight = binomial(dx, dy) * exp(-distance);
      for (uint c = 0; c < 3; ++c) sum[c] += weight * light_at(c, tap, near.albedo[c]);
      weights += weight;
    }
  }
  for (uint c = 0; c < 3; ++c) {
    target.v[address(c, id.y, id.x, p.plane, p.width)] = STORAGE(storable(sum[c] / weights));
  }
  count_saturated();
}
