// Computes the network's output with a joint base: a residual plus the mean of five candidates, weighted by
// the softmax of the other channels of `rec`. The candidates are upsampled LRHS, its upsampled irradiance
// times albedo + floor, and three levels of the joint filter. Each invocation computes one pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "bilinear.glsl"
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, rec) ADDRESS(Values, lrhs) ADDRESS(Values, albedo) ADDRESS(Values, filtered)
  ADDRESS(Values, target)
  Upsampled p;
};
BUFFER(1, readonly, Rec, STORAGE, rec)
BUFFER(2, readonly, Lrhs, STORAGE, lrhs)
BUFFER(3, readonly, Albedo, STORAGE, albedo)
BUFFER(4, readonly, Filtered, STORAGE, filtered)
BUFFER(5, writeonly, Target, STORAGE, target)
#define UPSAMPLED p
#include "lrhs.glsl"

const uint kCandidates = RAYMELD_CANDIDATES;

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  uint pixel = address(0, id.y, id.x, p.plane, p.width);
  float weights[kCandidates], largest = float(rec.v[pixel + 3 * p.plane]), total = 0.0;
  for (uint i = 1; i < kCandidates; ++i) largest = max(largest, float(rec.v[pixel + (3 + i) * p.plane]));
  for (uint i = 0; i < kCandidates; ++i) {
    weights[i] = exp(float(rec.v[pixel + (3 + i) * p.plane]) - largest);
    total += weights[i];
  }
  Bilinear at = bilinear_at(id, p.phase, p.inverse_scale, uvec2(p.lrhs_width, p.lrhs_height));
  for (uint c = 0; c < 3; ++c) {
    uint element = pixel + c * p.plane;
    float lit = clamp(to_linear(upsampled(3 + c, at), p.log_transfer), 0.0, 65504.0);
    float textured = to_network(lit * (float(albedo.v[element]) + RAYMELD_ALBEDO_FLOOR), p.log_transfer);
    float sum = weights[0] * upsampled(c, at) + weights[1] * textured;
    for (uint i = 0; i < 3; ++i) sum += weights[2 + i] * float(filtered.v[element + 3 * i * p.plane]);
    target.v[element] = STORAGE(storable(float(rec.v[element]) + sum / total));
  }
  count_saturated();
}
