// Adds the colors of HRLS to the converged image's sum.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

void main() {
  const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = full_size();
  if (!inside(pixel, size)) return;
  for (uint c = 0; c < 3; ++c) {
    const uint i = at(c, pixel, size);
    const float before = constants.accumulated_frames > 0 ? accumulated[i] : 0;
    accumulated[i] = before + hrls[at(kColor + c, pixel, size)];
  }
}
