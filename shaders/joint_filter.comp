// One level of an a-trous filter (Dammertz et al. 2010): the mean of 3x3 pixels `step` apart, edges replicated, weighted
// by a binomial kernel and by how alike their albedo, normal and brightness are. One invocation for each pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
layout(push_constant) uniform Push { JointFilter p; };
layout(std430, binding = 1) readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 2) readonly buffer Albedo { STORAGE albedo[]; };
layout(std430, binding = 3) readonly buffer Normal { STORAGE normal[]; };
layout(std430, binding = 4) readonly buffer Brightness { STORAGE brightness[]; };
layout(std430, binding = 5) writeonly buffer Output { STORAGE out_data[]; };

struct Guides {
  vec3 albedo, normal;
  float brightness;
};

vec3 color_of(uvec2 at) {
  uint i = address(0, at.y, at.x, p.plane, p.width);
  return vec3(in_data[i], in_data[i + p.plane], in_data[i + 2 * p.plane]);
}

Guides guides_of(uvec2 at) {
  uint i = address(0, at.y, at.x, p.plane, p.width), j = i + p.plane, k = j + p.plane;
  return Guides(vec3(albedo[i], albedo[j], albedo[k]), vec3(normal[i], normal[j], normal[k]), float(brightness[i]));
}

float squared(vec3 v) { return dot(v, v); }

float squared_distance(Guides a, Guides b) {
  float brightness = (a.brightness - b.brightness) / RAYMELD_BRIGHTNESS_WIDTH;
  return squared((a.albedo - b.albedo) / RAYMELD_ALBEDO_WIDTH) +
         squared((a.normal - b.normal) / RAYMELD_NORMAL_WIDTH) + brightness * brightness;
}

void main() {
  uvec2 id = gl_GlobalInvocationID.xy;
  if (id.x >= p.width || id.y >= p.height) return;
  Guides own = guides_of(id);
  vec3 sum = vec3(0.0);
  float weights = 0.0;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      ivec2 tap = clamp(ivec2(id) + int(p.step) * ivec2(dx, dy), ivec2(0), ivec2(p.width, p.height) - 1);
      float kernel = (dy == 0 ? 0.5 : 0.25) * (dx == 0 ? 0.5 : 0.25);
      float weight = kernel * exp(-squared_distance(guides_of(uvec2(tap)), own));
      sum += weight * color_of(uvec2(tap));
      weights += weight;
    }
  }
  for (uint c = 0; c < 3; ++c) {
    out_data[address(c, id.y, id.x, p.plane, p.width)] = STORAGE(storable(sum[c] / weights));
  }
}
