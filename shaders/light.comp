// What the joint filter filters and what guides it: channels 0 to 2 are log(1 + compress * light) / compress, light
// being HRLS without its albedo; channel 3 is the luminance of the upsampled irradiance. One invocation for each pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "bilinear.glsl"
#include "params.h"
#include "tensor.glsl"
#include "transfer.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
layout(push_constant) uniform Push { Upsampled p; };
layout(std430, binding = 1) readonly buffer Color { STORAGE color[]; };
layout(std430, binding = 2) readonly buffer Albedo { STORAGE albedo[]; };
layout(std430, binding = 3) readonly buffer Low { STORAGE irradiance[]; };
layout(std430, binding = 4) writeonly buffer Output { STORAGE out_data[]; };

float luminance_at(uint y, uint x) {
  vec3 rgb;
  for (uint c = 0; c < 3; ++c) rgb[c] = float(irradiance[address(c, y, x, p.lrhs_plane, p.lrhs_width)]);
  return dot(rgb, vec3(0.2126, 0.7152, 0.0722));
}

void main() {
  uvec2 id = gl_GlobalInvocationID.xy;
  if (id.x >= p.width || id.y >= p.height) return;
  for (uint c = 0; c < 3; ++c) {
    uint at = address(c, id.y, id.x, p.plane, p.width);
    float light = to_linear(float(color[at]), p.log_transfer) / (float(albedo[at]) + RAYMELD_ALBEDO_FLOOR);
    out_data[at] = STORAGE(storable(log(1.0 + RAYMELD_COMPRESS * light) / RAYMELD_COMPRESS));
  }
  Bilinear at = bilinear_at(id, p.phase, p.inverse_scale, uvec2(p.lrhs_width, p.lrhs_height));
  float brightness = blended(at, vec4(luminance_at(at.low.y, at.low.x), luminance_at(at.low.y, at.high.x),
                                      luminance_at(at.high.y, at.low.x), luminance_at(at.high.y, at.high.x)));
  out_data[address(3, id.y, id.x, p.plane, p.width)] = STORAGE(storable(brightness));
}
