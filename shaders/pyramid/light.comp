// Writes the demodulated radiance of HRLS without its fireflies, x = radiance / (albedo + floor), as
// log(1 + compress * x) / compress. Where LRHS is every kScale-th pixel of a full-size render, x is the mean
// of both renders at these pixels. Each invocation computes a strip of pixels, so that the luminance of a
// pixel is computed once and not for each of the three rows that need it.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "firefly.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
layout(constant_id = 0) const uint kScale = 0;  // 0: LRHS is not read
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, color) ADDRESS(Values, albedo) ADDRESS(Values, lrhs) ADDRESS(Values, target)
  Light p;
};
BUFFER(1, readonly, Color, STORAGE, color)
BUFFER(2, readonly, Albedo, STORAGE, albedo)
BUFFER(3, readonly, Lrhs, STORAGE, lrhs)
BUFFER(4, writeonly, Target, STORAGE, target)
#include "strip.glsl"

vec3 color_at(ivec2 at) {
  vec3 rgb;
  for (uint c = 0; c < 3; ++c)
    rgb[c] = to_linear(float(color.v[address(c, at.y, at.x, p.plane, p.width)]), p.log_transfer);
  return rgb;
}

// Holds the colors of a strip, and the luminances of its pixels and of those around it, 0 outside the image.
struct Neighbours {
  vec3 own[kStrip];
  float luminances[kStrip + 2][3];
};

// Returns the neighbours of the strip at `id`, where `last` is the image's last pixel.
Neighbours neighbours_of(uvec2 id, ivec2 last) {
  Neighbours result;
  [[unroll]] for (uint row = 0; row < kStrip + 2; ++row) {
    [[unroll]] for (uint column = 0; column < 3; ++column) {
      ivec2 at = ivec2(id.x, kStrip * id.y) + ivec2(column, row) - 1;
      ivec2 inside = clamp(at, ivec2(0), last);
      vec3 color = color_at(inside);
      result.luminances[row][column] = at == inside ? dot(color, kLuminance) : 0.0;
      if (column == 1 && row >= 1 && row <= kStrip) result.own[row - 1] = color;
    }
  }
  return result;
}

// Returns the luminances of the 3x3 pixels around pixel `row` of the strip.
float[9] around(Neighbours near, uint row) {
  float result[9];
  [[unroll]] for (uint i = 0; i < 9; ++i) result[i] = near.luminances[row + i / 3][i % 3];
  return result;
}

void main() {
  uvec2 id = global_invocation_id().xy;
  Strip strip = strip_at(id, uvec2(p.width, p.height));
  Neighbours near = neighbours_of(id, ivec2(p.width, p.height) - 1);
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    vec3 own = near.own[k] * firefly_limit(around(near, k));
    uvec2 pixel = strip.pixels[k], cell = kScale > 0 ? pixel / kScale : uvec2(0);
    bool is_shown = pixel == kScale * cell;
    [[unroll]] for (uint c = 0; c < 3; ++c) {
      uint element = address(c, pixel.y, pixel.x, p.plane, p.width);
      float surface = float(albedo.v[element]) + RAYMELD_ALBEDO_FLOOR, x = own[c] / surface;
      if (kScale > 0) {
        uint from = address(c, cell.y, cell.x, p.lrhs_plane, p.width / kScale);
        float given = to_linear(float(lrhs.v[from]), p.log_transfer) / surface;
        x = is_shown ? (x + p.lrhs_certainty * given) / (1.0 + p.lrhs_certainty) : x;
      }
      float value = log(1.0 + RAYMELD_COMPRESS * x) / RAYMELD_COMPRESS;
      if (strip.wanted[k]) target.v[element] = STORAGE(storable(value));
    }
  }
  count_saturated();
}
