// The models' variance layer: of each channel of HRLS, over 3x3 pixels, edges replicated.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

void main() {
  const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = full_size();
  if (!inside(pixel, size)) return;
  for (uint c = 0; c < 3; ++c) {
    float near[9], mean = 0;
    for (int i = 0; i < 9; ++i) {
      near[i] = hrls[at(kColor + c, clamp(pixel + ivec2(i % 3, i / 3) - 1, ivec2(0), size - 1), size)];
      mean += near[i] / 9;
    }
    float variance = 0;
    for (int i = 0; i < 9; ++i) variance += (near[i] - mean) * (near[i] - mean) / 9;
    hrls[at(kVariance + c, pixel, size)] = variance;
  }
}
