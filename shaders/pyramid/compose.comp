// Computes the output of a pyramid network. The albedo is filtered as in kernel_filter.comp, by 3x3 kernels
// of eleven logits of `rec`, and multiplies the filtered light. The image that this gives, encoded, is mixed
// with the upsampled LRHS, and the residual of `rec` is added. Each invocation computes one pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "bilinear.glsl"
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "share.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, rec) ADDRESS(Values, light) ADDRESS(Values, guides) ADDRESS(Values, lrhs)
  ADDRESS(Values, target)
  Upsampled p;
};
BUFFER(1, readonly, Rec, STORAGE, rec)
BUFFER(2, readonly, Filtered, STORAGE, light)
BUFFER(3, readonly, Guides, STORAGE, guides)
BUFFER(4, readonly, Lrhs, STORAGE, lrhs)
BUFFER(5, writeonly, Target, STORAGE, target)
#define UPSAMPLED p
#include "lrhs.glsl"
#include "affinity.glsl"

const uint kFirstLogit = 4;  // after the residual and the logit of the mixture

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  uint pixel = address(0, id.y, id.x, p.plane, p.width), logits = pixel + kFirstLogit * p.plane;
  Surface own = surface_of(pixel, p.plane), surfaces[9];
  vec2 factors =
      vec2(RAYMELD_ALBEDO_AFFINITY * affinity_factor(float(rec.v[logits + 9 * p.plane])),
           RAYMELD_NORMAL_AFFINITY * affinity_factor(float(rec.v[logits + 10 * p.plane])));
  float values[9], largest = float(rec.v[logits + 4 * p.plane]);  // that of the pixel itself
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    ivec2 at = clamp(ivec2(id) + ivec2(i % 3, i / 3) - 1, ivec2(0), ivec2(p.width, p.height) - 1);
    surfaces[i] = surface_of(address(0, uint(at.y), uint(at.x), p.plane, p.width), p.plane);
    values[i] = float(rec.v[logits + i * p.plane]) - unlikeness(own, surfaces[i], factors);
    largest = max(largest, values[i]);
  }
  vec3 surface = vec3(0.0);
  float total = 0.0;
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    float weight = exp(values[i] - largest);
    surface += weight * surfaces[i].albedo;
    total += weight;
  }
  surface = surface / total + RAYMELD_ALBEDO_FLOOR;
  float share = share_of(float(rec.v[pixel + 3 * p.plane]));
  Bilinear at = bilinear_at(id, p.phase, p.inverse_scale, uvec2(p.lrhs_width, p.lrhs_height));
  for (uint c = 0; c < 3; ++c) {
    uint element = pixel + c * p.plane;
    float x = (exp(RAYMELD_COMPRESS * float(light.v[element])) - 1.0) / RAYMELD_COMPRESS;
    float low = upsampled(c, at), filtered = to_network(x * surface[c], p.log_transfer);
    target.v[element] = STORAGE(storable(float(rec.v[element]) + low + share * (filtered - low)));
  }
  count_saturated();
}
