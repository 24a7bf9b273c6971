// Computes the input of the joint filter and a guide. Channels 0 to 2 are log(1 + compress * x) / compress,
// where x is the demodulated radiance of HRLS without its fireflies, averaged with the demodulated radiance
// of LRHS. Channel 3 is the certainty of x, channel 4 the luminance of the upsampled irradiance.
// Each invocation computes a strip of pixels, so that the luminance of a pixel is computed once and not for
// each of the three rows that need it.
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
#define UPSAMPLED p.upsampled
#include "lrhs.glsl"

vec3 color_at(ivec2 at) {
  vec3 rgb;
  for (uint c = 0; c < 3; ++c) {
    rgb[c] = to_linear(float(color.v[address(c, at.y, at.x, p.upsampled.plane, p.upsampled.width)]),
                       p.upsampled.log_transfer);
  }
  return rgb;
}

#include "fireflies.glsl"

vec3 irradiance_at(uint y, uint x) { return vec3(lrhs_at(3, y, x), lrhs_at(4, y, x), lrhs_at(5, y, x)); }

void demodulate(uvec2 pixel, vec3 own) {
  Bilinear at = bilinear_at(pixel, p.upsampled.phase, p.upsampled.inverse_scale,
                            uvec2(p.upsampled.lrhs_width, p.upsampled.lrhs_height));
  vec3 corners[4] = {irradiance_at(at.low.y, at.low.x), irradiance_at(at.low.y, at.high.x),
                     irradiance_at(at.high.y, at.low.x), irradiance_at(at.high.y, at.high.x)};
  bool centered = p.upsampled.phase > 0.0;
  float certainty = centered || (pixel & (p.scale - 1)) == uvec2(0) ? p.lrhs_certainty : 0.0;
  vec3 irradiance;
  [[unroll]] for (uint c = 0; c < 3; ++c) {
    uint element = address(c, pixel.y, pixel.x, p.upsampled.plane, p.upsampled.width);
    float surface = float(albedo.v[element]) + RAYMELD_ALBEDO_FLOOR;
    irradiance[c] = blended(at, vec4(corners[0][c], corners[1][c], corners[2][c], corners[3][c]));
    float light = own[c] / surface;
    if (certainty > 0.0) {
      float given = centered ? clamp(to_linear(irradiance[c], p.upsampled.log_transfer), 0.0, 65504.0)
                             : to_linear(lrhs_at(c, at.low.y, at.low.x), p.upsampled.log_transfer) / surface;
      light = (light + certainty * given) / (1.0 + certainty);
    }
    target.v[element] = STORAGE(storable(log(1.0 + RAYMELD_COMPRESS * light) / RAYMELD_COMPRESS));
  }
  target.v[address(3, pixel.y, pixel.x, p.upsampled.plane, p.upsampled.width)] =
      STORAGE(storable(1.0 + certainty));
  target.v[address(4, pixel.y, pixel.x, p.upsampled.plane, p.upsampled.width)] =
      STORAGE(storable(dot(irradiance, kLuminance)));
}

void main() {
  uvec2 id = global_invocation_id().xy;
  Strip strip = strip_at(id, uvec2(p.upsampled.width, p.upsampled.height));
  Neighbours near = neighbours_of(id, ivec2(p.upsampled.width, p.upsampled.height) - 1);
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    if (strip.wanted[k]) demodulate(strip.pixels[k], near.own[k] * firefly_limit(near.luminances, k));
  }
  count_saturated();
}
