// From the network's output, plus the upsampled encoded LRHS where the model predicts a residual, to scene linear
// floats in [0, 65504], un-exposed. One invocation for each element; z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
layout(push_constant) uniform Push { Decode p; };
layout(std430, binding = 1) readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 2) readonly buffer Lrhs { STORAGE lrhs[]; };
layout(std430, binding = 3) writeonly buffer Frame { float frame[]; };
layout(std430, binding = 4) readonly buffer Exposure { float exposure, inverse_exposure; };

float lrhs_at(uint c, uint y, uint x) { return float(lrhs[address(c, y, x, p.lrhs_plane, p.lrhs_width)]); }

// Exact in float: the inverse of a scale is a power of two, and a phase a multiple of one half.
// LRHS pixel (i, j) samples the full-size image at (scale * i + phase, scale * j + phase).
float bilinear(uint c, uint y, uint x) {
  vec2 last = vec2(p.lrhs_width - 1, p.lrhs_height - 1);
  vec2 at = clamp((vec2(x, y) - p.phase) * p.inverse_scale, vec2(0.0), last);
  uvec2 low = uvec2(at);
  uvec2 high = min(low + 1, uvec2(last));
  vec2 t = at - vec2(low);
  float top = mix(lrhs_at(c, low.y, low.x), lrhs_at(c, low.y, high.x), t.x);
  float bottom = mix(lrhs_at(c, high.y, low.x), lrhs_at(c, high.y, high.x), t.x);
  return mix(top, bottom, t.y);
}

void main() {
  uvec3 id = gl_GlobalInvocationID;
  if (id.x >= p.width || id.y >= p.height) return;
  // precise: a compiler that moved the sum into the interpolation would round in it at the sum's magnitude.
  precise float value = float(in_data[address(id.z, id.y, id.x, p.plane, p.width)]);
  if (p.bilinear_base != 0) value += bilinear(id.z, id.y, id.x);
  if (isnan(value) || isinf(value)) {
    atomicAdd(status.not_finite, 1u);
    value = 0.0;
  }
  // exp overflows where the result would be clamped anyway: log(1 + 8 * 65504 * 2^24) / 3 < 10, 2^24 being the
  // largest exposure.
  if (p.log_transfer != 0) value = (exp(3.0 * min(value, 10.0)) - 1.0) / 8.0;
  value = clamp(value * inverse_exposure, 0.0, 65504.0);
  frame[p.frame.offset + id.z * p.frame.channel_stride + id.y * p.frame.row_stride + id.x * p.frame.pixel_stride] =
      value;
}
