// Writes by how much the light has changed since the last frame, and how much of that is new. The light is
// the logarithm of LRHS's luminance, the mean of 3x3 pixels, against a history of its own. Noise differs from
// pixel to pixel and light changes in many alike, so the standard error of the mean change tells them apart.
// Nine pixels often seem to have less noise than they have, so the deviations of the last frames count as
// well. The history lags behind the light, so it holds too what was written for it in earlier frames. Each
// invocation computes a pixel.
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

vec3 color_at(uvec2 at) {
  vec3 color;
  [[unroll]] for (uint c = 0; c < 3; ++c)
    color[c] = to_linear(float(lrhs.v[address(c, at.y, at.x, p.plane, p.width)]), p.log_transfer);
  return color;
}

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

// Returns the variance in that of four directions where it is least. An edge differs from pixel to pixel, but
// not along the edge.
float variance_of(float values[9], bool known[9]) {
  float level = variance_along(values, known, 1, 0), upright = variance_along(values, known, 0, 1);
  float falling = variance_along(values, known, 1, 1), rising = variance_along(values, known, -1, 1);
  return min(min(level, upright), min(falling, rising));
}

// Holds what 3x3 pixels say of the light, some of which are not `known` in the last frames.
struct Around {
  float now[9], before[9];  // the luminance
  float deviations[9];      // its mean absolute deviation in the last frames
  bool known[9];
};

// Holds the change of the light, as a logarithm, that is not noise; what of it the history will not have
// caught up with when it has joined this frame; and the deviation of the middle pixel from the mean change.
struct Change {
  float light, left, residual;
};

// Returns the change where the history has so many frames. It is 0 up to the error of the mean, and most of
// the mean change from twice the error on. What was `corrected` in earlier frames is no noise.
Change change_of(Around around, float frames, float corrected) {
  float count = 0.0, now = 0.0, before = 0.0, spread = 0.0, changes[9];
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    count += around.known[i] ? 1.0 : 0.0;
    now += around.known[i] ? around.now[i] : 0.0;
    before += around.known[i] ? around.before[i] : 0.0;
    spread += around.known[i] ? around.deviations[i] * around.deviations[i] : 0.0;
    changes[i] = around.now[i] - around.before[i];
  }
  if (count < 2.0) return Change(corrected, corrected, around.deviations[4]);
  now /= count;
  before /= count;
  float variance = variance_of(changes, around.known);
  variance = clamp(RAYMELD_LIGHT_SPREAD * spread / count, variance, RAYMELD_LIGHT_MOST_VARIANCE * variance);
  float error = RAYMELD_LIGHT_ERRORS * sqrt(variance / count) / (min(now, before) + RAYMELD_LIGHT_FLOOR);
  float noise = (error + RAYMELD_LIGHT_NOISE) * (error + RAYMELD_LIGHT_NOISE);
  float change = log(now + RAYMELD_LIGHT_FLOOR) - log(before + RAYMELD_LIGHT_FLOOR);
  float square = max(change * change, 1e-12), known = clamp(corrected * change / square, 0.0, 1.0);
  float share = max(1.0 - noise / square, known);
  float joined = (frames * before + now) / (frames + 1.0);
  float left = log(now + RAYMELD_LIGHT_FLOOR) - log(joined + RAYMELD_LIGHT_FLOOR);
  return Change(share * change, share * left, abs(changes[4] - (now - before)));
}

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  Place place = place_of_recording();
  float factor = exposure.v[0], inverse = exposure.v[1];
  uvec2 size = uvec2(place.width, place.height) / p.scale, origin = uvec2(place.x, place.y) / p.scale;
  uint plane = size.x * size.y, first = p.planes * place.width * place.height;
  uvec2 own = min(id, uvec2(p.frame_width, p.frame_height) - 1);

  Around around;
  vec3 past = vec3(0.0);
  float frames = 0.0, corrected = 0.0;
  vec2 point = vec2(own + origin) + motion_of(own);
  [[unroll]] for (int i = 0; i < 9; ++i) {
    ivec2 away = ivec2(i % 3, i / 3) - 1;
    uvec2 at = uvec2(clamp(ivec2(own) + away, ivec2(0), ivec2(p.frame_width, p.frame_height) - 1));
    around.now[i] = dot(color_at(at), kLuminance);
    Taps taps = taps_at(point + vec2(away), size);
    float weights = 0.0, deviation = 0.0, left = 0.0;
    vec3 color = vec3(0.0);
    [[unroll]] for (uint k = 0; k < 4; ++k) {
      uint element = first + taps.pixels[k].y * size.x + taps.pixels[k].x;
      float count = last.v[5 * plane + element], weight = count > 0.0 ? taps.weights[k] : 0.0;
      weights += weight;
      frames += i == 4 ? weight * count : 0.0;
      [[unroll]] for (uint c = 0; c < 3; ++c) color[c] += weight * last.v[c * plane + element];
      deviation += weight * last.v[3 * plane + element];
      left += weight * last.v[4 * plane + element];
    }
    float share = factor / max(weights, 1e-6);
    around.before[i] = dot(color * share, kLuminance);
    around.deviations[i] = deviation * share;
    around.known[i] = weights > 0.0;
    if (i == 4) past = color * share;
    if (i == 4) corrected = left / max(weights, 1e-6);
  }

  frames = min(frames, RAYMELD_MOST_LRHS_FRAMES - 1.0);
  Change change = change_of(around, frames, corrected);
  uvec2 core = p.scale * own - uvec2(place.core_x, place.core_y);
  if (id == own && core.x < place.core_width && core.y < place.core_height) {
    float mean = around.deviations[4];
    float most = RAYMELD_LIGHT_OUTLIER * mean + RAYMELD_LIGHT_FIRST / max(frames - 1.0, 1e-6);
    float deviation = mean + (min(change.residual, most) - mean) / max(frames, 1.0);
    // In a first frame the neighbours tell.
    bool all[9] = bool[9](true, true, true, true, true, true, true, true, true);
    if (frames <= 0.0) deviation = sqrt(RAYMELD_LIGHT_SPREAD * variance_of(around.now, all));
    vec3 color = color_at(own), joined = frames > 0.0 ? (frames * past + color) / (frames + 1.0) : color;
    uint element = first + (own.y + origin.y) * size.x + own.x + origin.x;
    [[unroll]] for (uint c = 0; c < 3; ++c) next.v[c * plane + element] = joined[c] * inverse;
    next.v[3 * plane + element] = deviation * inverse;
    next.v[4 * plane + element] = change.left;
    next.v[5 * plane + element] = frames + 1.0;
  }
  float earlier = corrected * sign(change.light), grown = max(abs(change.light) - max(earlier, 0.0), 0.0);
  target.v[address(0, id.y, id.x, p.plane, p.width)] = STORAGE(storable(change.light - corrected));
  target.v[address(1, id.y, id.x, p.plane, p.width)] = STORAGE(storable(grown));
  count_saturated();
}
