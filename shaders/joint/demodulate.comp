// What the joint filter filters and what guides it: channels 0 to 2 are log(1 + compress * light) / compress, light
// being HRLS without its fireflies and its albedo, averaged with that of LRHS; channel 3 is the certainty of it, channel
// 4 the luminance of the upsampled irradiance. One invocation for a strip of pixels, so that each pixel's
// luminance is computed once for the three rows that it is a neighbour of.
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
  ADDRESS(Values, color) ADDRESS(Values, albedo) ADDRESS(Values, lrhs) ADDRESS(Values, target)
  Demodulate p;
};
BUFFER(1, readonly, Color, STORAGE, color)
BUFFER(2, readonly, Albedo, STORAGE, albedo)
BUFFER(3, readonly, Lrhs, STORAGE, lrhs)
BUFFER(4, writeonly, Target, STORAGE, target)
#include "strip.glsl"
#define UPSAMPLED p.of
#include "lrhs.glsl"

const vec3 kLuminance = vec3(0.2126, 0.7152, 0.0722);

vec3 color_at(ivec2 at) {
  vec3 rgb;
  for (uint c = 0; c < 3; ++c) {
    rgb[c] = to_linear(float(color.v[address(c, at.y, at.x, p.of.plane, p.of.width)]), p.of.log_transfer);
  }
  return rgb;
}

// What to multiply a pixel by so that it is no firefly: not many times as bright as the second brightest of its neighbours. It
// is in the middle of the 3x3 luminances from `row` on; outside of the image it is dark.
float firefly_limit(float luminances[kStrip + 2][3], uint row) {
  float first = 0.0, second = 0.0;
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    if (i == 4) continue;
    float near = luminances[row + i / 3][i % 3];
    second = max(second, min(first, near));
    first = max(first, near);
  }
  return min(1.0, (RAYMELD_FIREFLY * second + RAYMELD_FIREFLY_FLOOR) / max(luminances[row + 1][1], RAYMELD_FIREFLY_FLOOR));
}

vec3 irradiance_at(uint y, uint x) { return vec3(lrhs_at(3, y, x), lrhs_at(4, y, x), lrhs_at(5, y, x)); }

void demodulate(uvec2 pixel, vec3 own) {
  Bilinear at = bilinear_at(pixel, p.of.phase, p.of.inverse_scale, uvec2(p.of.lrhs_width, p.of.lrhs_height));
  vec3 corners[4] = {irradiance_at(at.low.y, at.low.x), irradiance_at(at.low.y, at.high.x),
                     irradiance_at(at.high.y, at.low.x), irradiance_at(at.high.y, at.high.x)};
  bool centered = p.of.phase > 0.0;
  float certainty = centered || (pixel & (p.scale - 1)) == uvec2(0) ? p.lrhs_certainty : 0.0;
  vec3 irradiance;
  [[unroll]] for (uint c = 0; c < 3; ++c) {
    uint element = address(c, pixel.y, pixel.x, p.of.plane, p.of.width);
    float surface = float(albedo.v[element]) + RAYMELD_ALBEDO_FLOOR;
    irradiance[c] = blended(at, vec4(corners[0][c], corners[1][c], corners[2][c], corners[3][c]));
    float light = own[c] / surface;
    if (certainty > 0.0) {
      float given = centered ? clamp(to_linear(irradiance[c], p.of.log_transfer), 0.0, 65504.0)
                             : to_linear(lrhs_at(c, at.low.y, at.low.x), p.of.log_transfer) / surface;
      light = (light + certainty * given) / (1.0 + certainty);
    }
    target.v[element] = STORAGE(storable(log(1.0 + RAYMELD_COMPRESS * light) / RAYMELD_COMPRESS));
  }
  target.v[address(3, pixel.y, pixel.x, p.of.plane, p.of.width)] = STORAGE(storable(1.0 + certainty));
  target.v[address(4, pixel.y, pixel.x, p.of.plane, p.of.width)] = STORAGE(storable(dot(irradiance, kLuminance)));
}

void main() {
  uvec2 id = global_invocation_id().xy;
  Strip strip = strip_at(id, uvec2(p.of.width, p.of.height));
  vec3 own[kStrip];
  float luminances[kStrip + 2][3];
  [[unroll]] for (uint row = 0; row < kStrip + 2; ++row) {
    [[unroll]] for (uint column = 0; column < 3; ++column) {
      ivec2 at = ivec2(id.x, kStrip * id.y) + ivec2(column, row) - 1, last = ivec2(p.of.width, p.of.height) - 1;
      ivec2 inside = clamp(at, ivec2(0), last);
      vec3 color = color_at(inside);
      luminances[row][column] = at == inside ? dot(color, kLuminance) : 0.0;
      if (column == 1 && row >= 1 && row <= kStrip) own[row - 1] = color;
    }
  }
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    if (strip.wanted[k]) demodulate(strip.pixels[k], own[k] * firefly_limit(luminances, k));
  }
}
