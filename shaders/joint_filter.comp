// One level of an a-trous filter (Dammertz et al. 2010): the mean of 3x3 pixels `step` apart, edges replicated, weighted
// by a binomial kernel, by how alike their albedo, normal and brightness are, and by their certainty, channel 3, of which
// the mean is passed on (normalized convolution, Knutsson and Westin 1993). One invocation for each strip of pixels, `step`
// apart below one another, which share what is around them.
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

const int kStrip = RAYMELD_JOINT_STRIP;

struct Tap {
  Surface surface;
  float brightness;
};

struct Sums {
  vec3 light;
  float certainty, weight;
};

uint address_of(ivec2 pixel) {
  ivec2 inside = clamp(pixel, ivec2(0), ivec2(p.width, p.height) - 1);
  return address(0, inside.y, inside.x, p.plane, p.width);
}

Tap tap_at(uint i) { return Tap(surface_of(i, p.plane), float(brightness.v[i])); }

void add(inout Sums sums, Tap own, Tap tap, vec4 value, float kernel) {
  float difference = (tap.brightness - own.brightness) / RAYMELD_BRIGHTNESS_WIDTH;
  float weight = kernel * exp(-(squared_distance(tap.surface, own.surface) + difference * difference));
  float certainty = weight * value.w;
  sums.light += certainty * value.xyz;
  sums.certainty += certainty;
  sums.weight += weight;
}

bool is_wanted(uvec2 pixel) { return pixel.y < p.height && !is_left_out(pixel); }

void main() {
  uvec2 id = gl_GlobalInvocationID.xy;
  ivec2 first = ivec2(id.x, id.y / p.step * p.step * kStrip + id.y % p.step), next = ivec2(0, p.step);
  bool any = false;
  [[unroll]] for (int k = 0; k < kStrip; ++k) any = any || is_wanted(uvec2(first + k * next));
  if (first.x >= p.width || !any) return;
  Tap own[kStrip];
  Sums sums[kStrip];
  [[unroll]] for (int k = 0; k < kStrip; ++k) {
    own[k] = tap_at(address_of(first + k * next));
    sums[k] = Sums(vec3(0.0), 0.0, 0.0);
  }
  [[unroll]] for (int row = -1; row <= kStrip; ++row) {
    [[unroll]] for (int dx = -1; dx <= 1; ++dx) {
      uint i = address_of(first + row * next + ivec2(dx * int(p.step), 0)), j = i + p.plane, k = j + p.plane;
      Tap tap;
      if (dx == 0 && row >= 0 && row < kStrip) {
        tap = own[row];
      } else {
        tap = tap_at(i);
      }
      vec4 value = vec4(source.v[i], source.v[j], source.v[k], source.v[k + p.plane]);
      [[unroll]] for (int dy = -1; dy <= 1; ++dy) {
        int of = row - dy;
        if (of >= 0 && of < kStrip) add(sums[of], own[of], tap, value, binomial(dx, dy));
      }
    }
  }
  [[unroll]] for (int k = 0; k < kStrip; ++k) {
    uvec2 pixel = uvec2(first + k * next);
    if (!is_wanted(pixel)) continue;
    uint i = address(0, pixel.y, pixel.x, p.plane, p.width);
    for (uint c = 0; c < 3; ++c) {
      target.v[i + c * p.plane] = STORAGE(storable(sums[k].light[c] / sums[k].certainty));
    }
    target.v[i + 3 * p.plane] = STORAGE(storable(sums[k].certainty / sums[k].weight));
  }
}
