// Writes how much of the history is still right where the light has changed: exp() of minus the change of the
// logarithm of LRHS's luminance since the last frames, the mean of 3x3 pixels, beyond what may be noise.
// Noise differs from pixel to pixel and light changes in many alike, so the standard error of the mean change
// tells them apart. LRHS has a history of its own for that, which is kept for the next frame. Each invocation
// computes a pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "finite.glsl"
#include "frame.glsl"
#include "history.glsl"
#include "firefly.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Floats, last) ADDRESS(Floats, next) ADDRESS(Floats, exposure)
  ADDRESS(Values, lrhs) ADDRESS(Values, target)
  LightChange p;
};
BUFFER(2, readonly, Last, float, last)
BUFFER(3, , Next, float, next)
BUFFER(4, readonly, Exposure, float, exposure)
BUFFER(5, readonly, Lrhs, STORAGE, lrhs)
BUFFER(6, writeonly, Target, STORAGE, target)
#include "place.glsl"

float lrhs_at(uint c, uvec2 at) { return float(lrhs.v[address(c, at.y, at.x, p.plane, p.width)]); }

// Returns the mean motion of a cell, in pixels of LRHS.
vec2 motion_of(uvec2 cell) {
  vec2 sum = vec2(0.0);
  for (uint i = 0; i < p.scale * p.scale; ++i) {
    uvec2 at = p.scale * cell + uvec2(i % p.scale, i / p.scale);
    sum += motion_at(at);
  }
  return sum * p.mean_of_cell;
}

// Returns half of the mean squared difference of 3x3 values whose places differ by (dx, dy): the variance
// of what differs from value to value.
float variance_along(float values[9], bool known[9], int dx, int dy) {
  float sum = 0.0, count = 0.0;
  [[unroll]] for (int i = 0; i < 9; ++i) {
    int x = i % 3 + dx, y = i / 3 + dy, other = clamp(3 * y + x, 0, 8);
    bool counts = x >= 0 && x < 3 && y < 3 && known[i] && known[other];
    float difference = values[other] - values[i];
    sum += counts ? difference * difference : 0.0;
    count += counts ? 2.0 : 0.0;
  }
  return count > 0.0 ? sum / count : 1e30;
}

// Returns the change of the light in pixels of which some are known, as a logarithm, beyond what may be
// noise. An edge that moves differs from pixel to pixel as well, but not along the edge.
float change_beyond_noise(float now[9], float before[9], bool known[9]) {
  float count = 0.0, mean_now = 0.0, mean_before = 0.0, changes[9];
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    count += known[i] ? 1.0 : 0.0;
    mean_now += known[i] ? now[i] : 0.0;
    mean_before += known[i] ? before[i] : 0.0;
    changes[i] = now[i] - before[i];
  }
  if (count < 2.0) return 0.0;
  mean_now = mean_now / count + RAYMELD_LIGHT_FLOOR;
  mean_before = mean_before / count + RAYMELD_LIGHT_FLOOR;
  float variance = min(min(variance_along(changes, known, 1, 0), variance_along(changes, known, 0, 1)),
                       min(variance_along(changes, known, -1, 1), variance_along(changes, known, 1, 1)));
  float error = RAYMELD_LIGHT_ERRORS * sqrt(variance / count) / min(mean_now, mean_before);
  return max(abs(log(mean_now) - log(mean_before)) - RAYMELD_LIGHT_NOISE - error, 0.0);
}

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  Place place = place_of_recording();
  float factor = exposure.v[0], inverse = exposure.v[1];
  uvec2 size = uvec2(place.width, place.height) / p.scale, origin = uvec2(place.x, place.y) / p.scale;
  uint plane = size.x * size.y, first = p.planes * place.width * place.height;
  uvec2 own = min(id, uvec2(p.frame_width, p.frame_height) - 1);

  float now[9], before[9];
  bool known[9];
  vec3 low = vec3(0.0), high = vec3(0.0), past = vec3(0.0);
  [[unroll]] for (int i = 0; i < 9; ++i) {
    ivec2 near = ivec2(own) + ivec2(i % 3, i / 3) - 1;
    uvec2 at = uvec2(clamp(near, ivec2(0), ivec2(p.frame_width, p.frame_height) - 1));
    now[i] = 0.0;
    [[unroll]] for (uint c = 0; c < 3; ++c) {
      float value = lrhs_at(c, at);
      now[i] += kLuminance[c] * to_linear(value, p.log_transfer);
      low[c] = i == 0 ? value : min(low[c], value);
      high[c] = i == 0 ? value : max(high[c], value);
    }
  }
  vec2 point = vec2(own + origin) + motion_of(own);
  float frames = 0.0;
  [[unroll]] for (int i = 0; i < 9; ++i) {
    Taps taps = taps_at(point + vec2(i % 3, i / 3) - 1.0, size);
    float weights = 0.0;
    vec3 color = vec3(0.0);
    [[unroll]] for (uint k = 0; k < 4; ++k) {
      uint element = first + taps.pixels[k].y * size.x + taps.pixels[k].x;
      float count = last.v[3 * plane + element], weight = count > 0.0 ? taps.weights[k] : 0.0;
      weights += weight;
      frames += i == 4 ? weight * count : 0.0;
      [[unroll]] for (uint c = 0; c < 3; ++c) color[c] += weight * last.v[c * plane + element];
    }
    color *= factor / max(weights, 1e-6);
    before[i] = dot(color, kLuminance);
    known[i] = weights > 0.0;
    if (i == 4) past = color;
  }

  float unlike = 0.0, share = exp(-RAYMELD_LIGHT_CHANGE * change_beyond_noise(now, before, known));
  [[unroll]] for (uint c = 0; c < 3; ++c)
    unlike += beyond(to_network(past[c], p.log_transfer), low[c], high[c]);
  frames = min(frames * share * exp(-RAYMELD_HISTORY_LRHS * unlike), RAYMELD_MOST_LRHS_FRAMES - 1.0);
  uvec2 core = p.scale * own - uvec2(place.core_x, place.core_y);
  if (id == own && core.x < place.core_width && core.y < place.core_height) {
    uint element = first + (own.y + origin.y) * size.x + own.x + origin.x;
    [[unroll]] for (uint c = 0; c < 3; ++c) {
      float value = to_linear(lrhs_at(c, own), p.log_transfer);
      float joined = frames > 0.0 ? past[c] + (value - past[c]) / (frames + 1.0) : value;
      next.v[c * plane + element] = joined * inverse;
    }
    next.v[3 * plane + element] = frames + 1.0;
  }
  target.v[address(0, id.y, id.x, p.plane, p.width)] = STORAGE(storable(share));
  count_saturated();
}
