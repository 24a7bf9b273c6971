// Filters an image of three channels: each pixel becomes the mean of the side x side pixels around it, edges
// replicated, weighted by the softmax of its logits. With `coarse`, an image of half the size, one more logit
// says how much of its bilinear upsampling takes the place of the mean. With `guides`, two more say how much
// differences of albedo and normal take from the other logits. Each invocation computes one pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "bilinear.glsl"
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "share.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
layout(constant_id = 0) const int kSide = 5;
layout(constant_id = 1) const bool kHasCoarse = false;
layout(constant_id = 2) const bool kHasGuides = false;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, source) ADDRESS(Values, logits) ADDRESS(Values, coarse) ADDRESS(Values, guides)
  ADDRESS(Values, target)
  KernelFilter p;
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, readonly, Logits, STORAGE, logits)
BUFFER(3, readonly, Coarse, STORAGE, coarse)
BUFFER(4, readonly, Guides, STORAGE, guides)
BUFFER(5, writeonly, Target, STORAGE, target)
#include "affinity.glsl"

float coarse_at(uint c, uint y, uint x) {
  return float(coarse.v[address(c, y, x, p.coarse_plane, p.coarse_width)]);
}

float upsampled(uint c, Bilinear at) {
  return blended(at, vec4(coarse_at(c, at.low.y, at.low.x), coarse_at(c, at.low.y, at.high.x),
                          coarse_at(c, at.high.y, at.low.x), coarse_at(c, at.high.y, at.high.x)));
}

uint tap_at(uvec2 pixel, int dx, int dy) {
  ivec2 at = clamp(ivec2(pixel) + ivec2(dx, dy), ivec2(0), ivec2(p.width, p.height) - 1);
  return address(0, uint(at.y), uint(at.x), p.plane, p.width);
}

// Returns the logit of a tap, whose own logit is at address `logit`.
float logit_of(uint logit, uint tap, Surface own, vec2 factors) {
  float value = float(logits.v[logit]);
  return kHasGuides ? value - unlikeness(own, surface_of(tap, p.plane), factors) : value;
}

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  const int kReach = kSide / 2;
  uint pixel = address(0, id.y, id.x, p.plane, p.width), further = pixel + kSide * kSide * p.plane;
  Surface own = Surface(vec3(0.0), vec3(0.0));
  vec2 factors = vec2(0.0);
  if (kHasGuides) {
    uint first = further + (kHasCoarse ? p.plane : 0);
    own = surface_of(pixel, p.plane);
    factors = vec2(RAYMELD_ALBEDO_AFFINITY * affinity_factor(float(logits.v[first])),
                   RAYMELD_NORMAL_AFFINITY * affinity_factor(float(logits.v[first + p.plane])));
  }
  float largest = float(logits.v[pixel + kSide * kSide / 2 * p.plane]);  // that of the pixel itself
  uint logit = pixel;
  // Unrolled, both loops would share their logits, and keep them in registers that some GPUs lack.
  [[dont_unroll]] for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx) {
      largest = max(largest, logit_of(logit, tap_at(id, dx, dy), own, factors));
      logit += p.plane;
    }
  }
  vec3 sum = vec3(0.0);
  float total = 0.0;
  logit = pixel;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx) {
      uint tap = tap_at(id, dx, dy);
      float weight = exp(logit_of(logit, tap, own, factors) - largest);
      sum += weight * vec3(source.v[tap], source.v[tap + p.plane], source.v[tap + 2 * p.plane]);
      total += weight;
      logit += p.plane;
    }
  }
  sum /= total;
  if (kHasCoarse) {
    float share = share_of(float(logits.v[further]));
    Bilinear at = bilinear_at(id, 0.5, 0.5, uvec2(p.coarse_width, p.coarse_height));
    for (uint c = 0; c < 3; ++c) sum[c] += share * (upsampled(c, at) - sum[c]);
  }
  for (uint c = 0; c < 3; ++c) target.v[pixel + c * p.plane] = STORAGE(storable(sum[c]));
  count_saturated();
}
