// Computes the exposure of a recording and its inverse from the sums that exposure_sums.comp wrote: the key
// over the squared mean, clamped to [2^-24, 2^24], or 1 where all of the image is black. It runs as one
// workgroup.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "workgroup_sum.glsl"

layout(push_constant) uniform Push { FoundExposure p; };
layout(std430, binding = 1) readonly buffer Sums { float v[]; } sums;
layout(std430, binding = 2) writeonly buffer Written { float v[2]; } exposure;

void main() {
  uint self = local_invocation_index();
  float sum = workgroup_sum(self < p.sums ? sums.v[self] : 0.0);
  if (self != 0) return;
  float root = sum > 0.0 ? clamp(p.root / sum, 1.0 / 4096.0, 4096.0) : 1.0;
  exposure.v[0] = root * root;
  exposure.v[1] = 1.0 / (root * root);
}
