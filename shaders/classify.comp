// Which blocks of a sparse graph are needed: not those whose every pixel, in HRLS and in LRHS upsampled, has the same color but
// for a threshold, encoded. One workgroup for each block.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "bilinear.glsl"
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

const uint kInvocations = 64;
layout(local_size_x = kInvocations) in;
layout(constant_id = 0) const uint kTold = 0;  // among those that the host says are needed
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Values color, lrhs;
  Upsampled p;
};
#else
layout(push_constant) uniform Push { Upsampled p; };
layout(std430, binding = 1) readonly buffer Color { STORAGE v[]; } color;
layout(std430, binding = 2) readonly buffer Lrhs { STORAGE v[]; } lrhs;
#endif
#include "settled.glsl"

shared uint differ[kInvocations];

void main() {
  uint scale = p.width / p.lrhs_width, side = RAYMELD_SPARSE_SIDE * scale, self = gl_LocalInvocationIndex;
  uint block = RAYMELD_SPARSE_DISTANCES + gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  if (kTold != 0 && status.words[block] != 0) return;
  float threshold = uintBitsToFloat(status.words[RAYMELD_SPARSE_THRESHOLD]), largest = 0.0;
  for (uint i = self; i < side * side; i += kInvocations) {
    uvec2 at = min(gl_WorkGroupID.xy * side + uvec2(i % side, i / side), uvec2(p.width, p.height) - 1);
    Bilinear low = bilinear_at(at, p.phase, p.inverse_scale, uvec2(p.lrhs_width, p.lrhs_height));
    for (uint c = 0; c < 3; ++c) largest = max(largest, abs(color_at(c, at) - upsampled(c, low)));
  }
  differ[self] = uint(!(largest <= threshold));
  barrier();
  if (self != 0) return;
  uint any = 0;
  for (uint i = 0; i < kInvocations; ++i) any |= differ[i];
  status.words[block] = any != 0 ? 0 : ~0u;
}
