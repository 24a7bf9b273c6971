// One level of an a-trous filter (Dammertz et al. 2010): the mean of 3x3 pixels `step` apart, edges replicated, weighted
// by a binomial kernel, by how alike their albedo, normal and brightness are, and by their certainty, channel 3, of which
// the mean is passed on (normalized convolution, Knutsson and Westin 1993). One invocation for each pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Values source, albedo, normal, brightness, target;
  JointFilter p;
};
#else
layout(push_constant) uniform Push { JointFilter p; };
layout(std430, binding = 1) readonly buffer Source { STORAGE v[]; } source;
layout(std430, binding = 2) readonly buffer Albedo { STORAGE v[]; } albedo;
layout(std430, binding = 3) readonly buffer Normal { STORAGE v[]; } normal;
layout(std430, binding = 4) readonly buffer Brightness { STORAGE v[]; } brightness;
layout(std430, binding = 5) writeonly buffer Target { STORAGE v[]; } target;
#endif
#include "left_out.glsl"
#include "guides.glsl"

void main() {
  uvec2 id = gl_GlobalInvocationID.xy;
  if (id.x >= p.width || id.y >= p.height || is_left_out(id.xy)) return;
  uint own = address(0, id.y, id.x, p.plane, p.width);
  Surface own_surface = surface_of(own, p.plane);
  float own_brightness = float(brightness.v[own]);
  vec3 sum = vec3(0.0);
  float certainties = 0.0, weights = 0.0;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      ivec2 tap = clamp(ivec2(id) + int(p.step) * ivec2(dx, dy), ivec2(0), ivec2(p.width, p.height) - 1);
      uint i = address(0, tap.y, tap.x, p.plane, p.width), j = i + p.plane, k = j + p.plane;
      float difference = (float(brightness.v[i]) - own_brightness) / RAYMELD_BRIGHTNESS_WIDTH;
      float distance = squared_distance(surface_of(i, p.plane), own_surface) + difference * difference;
      float weight = binomial(dx, dy) * exp(-distance);
      float certainty = weight * float(source.v[k + p.plane]);
      sum += certainty * vec3(source.v[i], source.v[j], source.v[k]);
      certainties += certainty;
      weights += weight;
    }
  }
  for (uint c = 0; c < 3; ++c) {
    target.v[own + c * p.plane] = STORAGE(storable(sum[c] / certainties));
  }
  target.v[own + 3 * p.plane] = STORAGE(storable(certainties / weights));
}
