// Mixes the fused image with that of the last frame, which is read bilinearly where the motion leads and kept
// within the range of the 3x3 pixels around. So what the network draws anew in each frame flickers less. A
// pixel whose surface or light is new has no more samples than this frame gives, and stays as it is. The
// image is kept for the next frame as it was before. Each invocation computes a pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "finite.glsl"
#include "frame.glsl"
#include "history.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Floats, last) ADDRESS(Floats, next) ADDRESS(Floats, exposure)
  ADDRESS(Values, fused) ADDRESS(Values, samples) ADDRESS(Values, target)
  Settle p;
};
BUFFER(2, readonly, Last, float, last)
BUFFER(3, , Next, float, next)
BUFFER(4, readonly, Exposure, float, exposure)
BUFFER(5, readonly, Fused, STORAGE, fused)
BUFFER(6, readonly, Samples, STORAGE, samples)
BUFFER(7, writeonly, Target, STORAGE, target)
#include "place.glsl"

float fused_at(uint c, uvec2 at) { return float(fused.v[address(c, at.y, at.x, p.plane, p.width)]); }

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  Place place = place_of_recording();
  float factor = exposure.v[0], inverse = exposure.v[1];
  uint plane = place.width * place.height;
  ivec2 last_pixel = ivec2(p.frame_width, p.frame_height) - 1;
  uvec2 own = min(id, uvec2(last_pixel));

  Taps taps = taps_at(vec2(own + uvec2(place.x, place.y)) + motion_at(own), uvec2(place.width, place.height));
  float known = taps.weights[0] + taps.weights[1] + taps.weights[2] + taps.weights[3];
  float now = p.spp / exp2(float(samples.v[address(0, own.y, own.x, p.plane, p.width)]));
  float sharp = 1.0 - RAYMELD_SETTLED_BLUR * blur_of(taps);
  float old = max(1.0 - RAYMELD_SETTLED_MARGIN * now, 0.0);
  float share = known > 0.0 ? RAYMELD_SETTLED * sharp * old : 0.0;

  uvec2 core = own - uvec2(place.core_x, place.core_y);
  bool is_kept = id == own && core.x < place.core_width && core.y < place.core_height;
  uint element = (own.y + place.y) * place.width + own.x + place.x;
  [[unroll]] for (uint c = 0; c < 3; ++c) {
    float value = fused_at(c, own), low = value, high = value, past = 0.0;
    [[unroll]] for (uint i = 0; i < 9; ++i) {
      float near = fused_at(c, uvec2(clamp(ivec2(own) + ivec2(i % 3, i / 3) - 1, ivec2(0), last_pixel)));
      low = min(low, near);
      high = max(high, near);
    }
    uint first = (p.first + c) * plane;
    [[unroll]] for (uint i = 0; i < 4; ++i)
      past += taps.weights[i] * last.v[first + taps.pixels[i].y * place.width + taps.pixels[i].x];
    past = to_network(clamp(past * factor / max(known, 1e-6), 0.0, p.clip), p.log_transfer);
    if (is_kept) next.v[first + element] = max(to_linear(value, p.log_transfer), 0.0) * inverse;
    // A recorded frame may have left values that are not finite.
    float result = is_finite(past) ? value + share * (clamp(past, low, high) - value) : value;
    target.v[address(c, id.y, id.x, p.plane, p.width)] = STORAGE(storable(result));
  }
  count_saturated();
}
