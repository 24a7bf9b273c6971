// Tone-maps the view that is shown, to sRGB.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

layout(push_constant) uniform Push { uint view; };

// Returns the kernel of Keys 1981.
float cubic(float x) {
  x = abs(x);
  return x < 1 ? (1.5 * x - 2.5) * x * x + 1 : x < 2 ? ((2.5 - 0.5 * x) * x - 4) * x + 2 : 0;
}

vec3 bicubic_lrhs(ivec2 pixel) {
  const ivec2 size = small_size();
  const vec2 place = (vec2(pixel) + 0.5) / float(constants.scale) - 0.5;
  const ivec2 corner = ivec2(floor(place));
  vec3 sum = vec3(0);
  for (int i = 0; i < 16; ++i) {
    const ivec2 at_pixel = corner + ivec2(i % 4, i / 4) - 1;
    const vec2 away = place - vec2(at_pixel);
    const ivec2 near = clamp(at_pixel, ivec2(0), size - 1);
    for (uint c = 0; c < 3; ++c) sum[c] += cubic(away.x) * cubic(away.y) * lrhs[at(c, near, size)];
  }
  return sum;
}

void main() {
  const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = full_size();
  if (!inside(pixel, size) || !inside(pixel, imageSize(shown))) return;
  vec3 toned;
  if (view == kViewLrhs) {
    toned = tone(bicubic_lrhs(pixel));
  } else {
    for (uint c = 0; c < 3; ++c) {
      const uint i = at(c, pixel, size);
      toned[c] = view == kViewHrls    ? hrls[i]
                 : view == kViewFused ? fused[i]
                                      : accumulated[i] / (constants.accumulated_frames + 1);
    }
    toned = tone(toned);
  }
  imageStore(shown, pixel, vec4(srgb(clamp(toned, 0, 1)), 1));
}
