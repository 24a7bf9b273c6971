// Sums up the square roots of an image's luminance (Rec. 709), of colors clamped to [0, 65504] and with NaN
// as 0. An invocation takes every p.stride-th pixel, and a workgroup writes one sum.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "workgroup_sum.glsl"
#include "frame.glsl"

layout(push_constant) uniform Push { ExposureSums p; };
layout(std430, binding = 2) writeonly buffer Sums { float v[]; } sums;

float luminance(uvec2 at) {
#ifdef FRAME_IMAGE
  vec3 color = frame_texel(p.frame, at).rgb;
#else
  vec3 color = vec3(frame_value(p.frame, 0, at), frame_value(p.frame, 1, at), frame_value(p.frame, 2, at));
#endif
  // Compares instead of calling max, whose result for NaN is undefined in GLSL.
  [[unroll]] for (uint c = 0; c < 3; ++c) color[c] = color[c] > 0.0 ? min(color[c], 65504.0) : 0.0;
  return 0.2126 * color.r + 0.7152 * color.g + 0.0722 * color.b;
}

void main() {
  uint self = local_invocation_index();
  float sum = 0.0;
  for (uint i = gl_WorkGroupID.x * RAYMELD_SUMMANDS + self; i < p.height * p.width; i += p.stride) {
    uint y = i / p.width;
    sum += sqrt(luminance(uvec2(i - y * p.width, y)));
  }
  sum = workgroup_sum(sum);
  if (self == 0) sums.v[gl_WorkGroupID.x] = sum;
}
