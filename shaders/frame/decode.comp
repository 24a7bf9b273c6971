// Decodes the network's output: adds the upsampled encoded LRHS where the model predicts a residual,
// inverts the transfer, divides by the exposure, adds the radiance above the clip and clamps to [0, 65504].
// The network sees nothing above the clip. The radiance that above_clip.comp found is added only where the
// output is near the clip: nothing below an eighth of it, and all from a quarter on, so that the edges that
// the network drew stay. Each invocation decodes a strip of elements, z being the channel; with FRAME_IMAGE
// a strip of pixels.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "bilinear.glsl"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "finite.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
#ifdef FRAME_IMAGE
layout(binding = 1) uniform writeonly image2D frame;
#else
layout(std430, binding = 1) writeonly buffer Frame { float frame[]; };
#endif
layout(push_constant) uniform Push {
  ADDRESS(Floats, exposure)  // the exposure and its inverse
  ADDRESS(Values, source) ADDRESS(Values, lrhs) ADDRESS(Values, above_clip)
  Decode p;
};
BUFFER(2, readonly, Exposure, float, exposure)
BUFFER(3, readonly, Source, STORAGE, source)
BUFFER(4, readonly, Lrhs, STORAGE, lrhs)
BUFFER(5, readonly, Bright, STORAGE, above_clip)
#include "strip.glsl"
#define UPSAMPLED p.upsampled
#include "lrhs.glsl"

float above_clip_at(uint c, uint y, uint x) {
  return float(above_clip.v[address(c, y, x, p.upsampled.lrhs_plane, p.upsampled.lrhs_width)]);
}

// Returns the mean of the four samples around, weighted bilinearly and each by itself, so that the rim of a
// lamp has the lamp's radiance.
float upsampled_above_clip(uint c, Bilinear at) {
  vec4 samples = vec4(above_clip_at(c, at.low.y, at.low.x), above_clip_at(c, at.low.y, at.high.x),
                      above_clip_at(c, at.high.y, at.low.x), above_clip_at(c, at.high.y, at.high.x));
  vec4 weights = samples * vec2(1.0 - at.t.x, at.t.x).xyxy * vec2(1.0 - at.t.y, at.t.y).xxyy;
  float total = dot(weights, vec4(1.0));
  return total > 0.0 ? dot(weights, samples) / total : 0.0;
}

// Returns the decoded value. If it is not finite, it becomes 0 and, with `counted`, is counted.
float decoded(uint c, uvec2 pixel, Bilinear at, bool counted) {
  // `precise` keeps a compiler from moving the sum into the interpolation, which would then
  // round at the sum's magnitude.
  precise float value = float(source.v[address(c, pixel.y, pixel.x, p.upsampled.plane, p.upsampled.width)]);
  if (p.bilinear_base != 0) value += upsampled(c, at);
  if (!is_finite(value)) {
    if (counted) atomicAdd(status.not_finite, 1u);
    value = 0.0;
  }
  value = to_linear(value, p.upsampled.log_transfer);
  float share = p.clip > 0.0 ? clamp(8.0 * value / p.clip - 1.0, 0.0, 1.0) : 0.0;
  value *= exposure.v[1];
  if (share > 0.0) value += share * upsampled_above_clip(c, at);
  return clamp(value, 0.0, 65504.0);
}

void main() {
  uvec3 id = global_invocation_id();
  Strip strip = strip_at(id.xy, uvec2(p.frame_width, p.frame_height));
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    uvec2 at = strip.pixels[k];
    bool wanted = strip.wanted[k];
    Bilinear low = bilinear_at(at, p.upsampled.phase, p.upsampled.inverse_scale,
                               uvec2(p.upsampled.lrhs_width, p.upsampled.lrhs_height));
#ifdef FRAME_IMAGE
    vec4 pixel =
        vec4(decoded(0, at, low, wanted), decoded(1, at, low, wanted), decoded(2, at, low, wanted), 1.0);
    if (wanted) imageStore(frame, ivec2(at + uvec2(p.frame.x, p.frame.y)), pixel);
#else
    float value = decoded(id.z, at, low, wanted);
    if (wanted) {
      frame[p.frame.offset + id.z * p.frame.channel_stride + at.y * p.frame.row_stride +
            at.x * p.frame.pixel_stride] = value;
    }
#endif
  }
}
