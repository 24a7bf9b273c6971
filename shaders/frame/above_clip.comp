// Computes an image's radiance above the clip, scene linear and not exposed: max(0, x - clip / exposure), at
// most 65504 whatever the exposure; NaN counts as 0. Each invocation computes one element; z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "frame.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Floats, exposure)  // the exposure and its inverse
  ADDRESS(Values, target)
  AboveClip p;
};
BUFFER(2, readonly, Exposure, float, exposure)
BUFFER(3, writeonly, Target, STORAGE, target)

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= p.width || id.y >= p.height) return;
  float value = frame_value(p.frame, id.z, id.xy) - p.clip * exposure.v[1];
  // Compares instead of calling max, whose result for NaN is undefined in GLSL.
  value = value > 0.0 ? min(value, 65504.0) : 0.0;
  target.v[address(id.z, id.y, id.x, p.plane, p.width)] = STORAGE(storable(value));
  count_saturated();
}
