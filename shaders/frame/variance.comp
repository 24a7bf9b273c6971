// Computes the variance of HRLS's color as the network reads it: for each channel the mean over 3x3 pixels,
// edges replicated, of the squared difference from their mean, encoded as encode.comp does. Values that are
// not finite count as 0. Each invocation computes the three channels of a pixel, all that it fetches.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "finite.glsl"
#include "frame.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Floats, exposure)
  ADDRESS(Values, target)
  Variance p;
};
BUFFER(2, readonly, Exposure, float, exposure)
BUFFER(3, writeonly, Target, STORAGE, target)

vec3 color_at(ivec2 pixel) {
  uvec2 at = uvec2(clamp(pixel, ivec2(0), ivec2(p.frame_width, p.frame_height) - 1));
#ifdef FRAME_IMAGE
  vec3 color = frame_texel(p.frame, at).rgb;
#else
  vec3 color = vec3(frame_value(p.frame, 0, at), frame_value(p.frame, 1, at), frame_value(p.frame, 2, at));
#endif
  [[unroll]] for (uint c = 0; c < 3; ++c) color[c] = is_finite(color[c]) ? color[c] : 0.0;
  return color;
}

#include "variance.glsl"

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= p.width || id.y >= p.height) return;
  ivec2 own = ivec2(min(id.xy, uvec2(p.frame_width, p.frame_height) - 1));
  vec3 variance = variance_at(own) * (exposure.v[0] * exposure.v[0]);
  [[unroll]] for (uint c = 0; c < 3; ++c) {
    float value = to_network(min(variance[c], p.clip), p.log_transfer);
    target.v[address(c, id.y, id.x, p.plane, p.width)] = STORAGE(storable(value));
  }
  count_saturated();
}
