// Joins encoded HRLS with what the last frame knew of the same points, and keeps the result for the next. The
// history is read bilinearly where the motion leads. A pixel of it counts as far as its albedo, normal and
// depth lie within those of pixels around the pixel at hand. Thin things come and go among samples
// that move within the pixel, so these matter less where the last frame had the same motion: hardly anything
// has come into sight there. Where the light has changed, the history's radiance is corrected, and counts for
// fewer frames. Colors are joined as demodulated radiance, without the fireflies of this frame. Albedo and
// normal are joined less where reading between pixels blurs them. Each invocation computes a pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "finite.glsl"
#include "frame.glsl"
#include "bilinear.glsl"
#include "history.glsl"
#include "firefly.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Floats, last) ADDRESS(Floats, next) ADDRESS(Floats, exposure)
  ADDRESS(Values, hrls) ADDRESS(Values, change) ADDRESS(Values, target)
  Accumulate p;
};
BUFFER(2, readonly, Last, float, last)
BUFFER(3, , Next, float, next)
BUFFER(4, readonly, Exposure, float, exposure)
BUFFER(5, readonly, Hrls, STORAGE, hrls)
BUFFER(6, readonly, Change, STORAGE, change)
BUFFER(7, writeonly, Target, STORAGE, target)
#include "place.glsl"

const uint kGuides = 3;    // the first channel of albedo and normal
const uint kRadiance = 9;  // the first channel of other radiance

float hrls_at(uint c, uvec2 at) { return float(hrls.v[address(c, at.y, at.x, p.plane, p.width)]); }

float linear_at(uint c, uvec2 at) { return to_linear(hrls_at(c, at), p.log_transfer); }

vec3 color_at(uvec2 at) { return vec3(linear_at(0, at), linear_at(1, at), linear_at(2, at)); }

// Holds what the 3x3 pixels around one say of it.
struct Around {
  float low[6], high[6];  // the range of albedo and normal
  float firefly;          // the factor by which the color is to be darkened
};

Around around(uvec2 own) {
  Around result;
  [[unroll]] for (uint c = 0; c < 6; ++c) {
    result.low[c] = result.high[c] = hrls_at(kGuides + c, own);
  }
  ivec2 last_pixel = ivec2(p.frame_width, p.frame_height) - 1;
  float luminances[9];
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    ivec2 at = ivec2(own) + ivec2(i % 3, i / 3) - 1, inside = clamp(at, ivec2(0), last_pixel);
    luminances[i] = at == inside ? dot(color_at(uvec2(inside)), kLuminance) : 0.0;
    [[unroll]] for (uint c = 0; c < 6; ++c) {
      float value = hrls_at(kGuides + c, uvec2(inside));
      result.low[c] = min(result.low[c], value);
      result.high[c] = max(result.high[c], value);
    }
  }
  result.firefly = firefly_limit(luminances);
  return result;
}

bool is_depth(float depth) { return depth > 0.0 && is_finite(depth); }

// Returns the range of the logarithms of the depths that a pixel and the four beside it had in the last
// frame, or of all numbers where its depth is not known. Those that do not move with it lie on other
// surfaces.
vec2 depths_around(uvec2 own) {
  vec2 all = vec2(-1e30, 1e30);
  if (p.has_depth == 0) return all;
  float now = frame_value(p.motion, 2, own), before = frame_value(p.motion, 3, own);
  if (!is_depth(now) || !is_depth(before)) return all;
  vec2 motion = motion_at(own);
  float low = now, high = now;
  [[unroll]] for (uint i = 1; i < 9; i += 2) {
    ivec2 at = ivec2(own) + ivec2(i % 3, i / 3) - 1;
    uvec2 inside = uvec2(clamp(at, ivec2(0), ivec2(p.frame_width, p.frame_height) - 1));
    float depth = frame_value(p.motion, 2, inside);
    vec2 away = motion_at(inside) - motion;
    if (!is_depth(depth) || !(dot(away, away) <= RAYMELD_DEPTH_MOTION)) continue;
    low = min(low, depth);
    high = max(high, depth);
  }
  float since = log(before) - log(now);
  return vec2(log(low) + since - RAYMELD_DEPTH_TOLERANCE, log(high) + since + RAYMELD_DEPTH_TOLERANCE);
}

// Holds the motion to the history, the elements of a plane of it, their shares of its value, the frames
// behind it, and how much it is blurred: 0 where it is read at a pixel, 3/4 in the middle of four.
struct History {
  vec2 motion;
  uint elements[4];
  float shares[4];
  float frames, blur;
};

History history_of(uvec2 own, Place place, uint plane, Around near) {
  vec2 motion = motion_at(own);
  if (!is_finite(motion.x) || !is_finite(motion.y)) motion = vec2(RAYMELD_NOWHERE);
  Taps taps = taps_at(vec2(own + uvec2(place.x, place.y)) + motion, uvec2(place.width, place.height));
  vec2 depths = depths_around(own);
  History result;
  result.motion = motion;
  float sum = 0.0;
  result.frames = 0.0;
  result.blur = blur_of(taps);
  [[unroll]] for (uint i = 0; i < 4; ++i) {
    uint element = taps.pixels[i].y * place.width + taps.pixels[i].x;
    float of_albedo = 0.0, of_normal = 0.0;
    [[unroll]] for (uint c = 0; c < 6; ++c) {
      float away = beyond(last.v[(kGuides + c) * plane + element], near.low[c], near.high[c]);
      of_albedo += c < 3 ? away : 0.0;
      of_normal += c < 3 ? 0.0 : away;
    }
    vec2 before = vec2(last.v[p.channels * plane + element], last.v[(p.channels + 1) * plane + element]);
    float steady = exp(-RAYMELD_HISTORY_MOTION * dot(before - motion, before - motion)) * (1.0 - result.blur);
    float depth = last.v[(p.channels + 2) * plane + element];
    float of_depth = is_depth(depth) ? beyond(log(depth), depths.x, depths.y) : 0.0;
    float unlike = RAYMELD_HISTORY_ALBEDO * of_albedo + RAYMELD_HISTORY_NORMAL * of_normal +
                   RAYMELD_HISTORY_DEPTH * of_depth;
    float likeness = exp(-mix(1.0, RAYMELD_HISTORY_STEADY, steady) * unlike);
    float frames = last.v[(p.channels + 3) * plane + element];
    float weight = frames > 0.0 ? taps.weights[i] * likeness : 0.0;
    result.elements[i] = element;
    result.shares[i] = weight;
    result.frames += weight * frames;
    sum += weight;
  }
  [[unroll]] for (uint i = 0; i < 4; ++i) result.shares[i] = result.shares[i] / max(sum, 1e-6);
  return result;
}

// Returns a channel of the change of the light in the four pixels of LRHS around.
vec4 changes_at(Bilinear at, uint plane) {
  uint low = plane + at.low.y * p.change_width, high = plane + at.high.y * p.change_width;
  return vec4(change.v[low + at.low.x], change.v[low + at.high.x], change.v[high + at.low.x],
              change.v[high + at.high.x]);
}

// Returns the factor of the history's radiance and that of its frames where the light has changed.
vec2 factors_at(uvec2 own) {
  float phase = 0.5 / p.inverse_scale - 0.5;
  Bilinear at = bilinear_at(own, phase, p.inverse_scale, uvec2(p.change_width, p.change_height));
  float mean = blended(at, changes_at(at, 0));
  vec4 grown = changes_at(at, p.change_plane);
  float most = max(max(grown.x, grown.y), max(grown.z, grown.w));
  return vec2(exp(clamp(mean, -RAYMELD_LIGHT_MOST, RAYMELD_LIGHT_MOST)),
              exp(-most * (RAYMELD_LIGHT_CHANGE + RAYMELD_LIGHT_LARGE * most)));
}

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  Place place = place_of_recording();
  float factor = exposure.v[0], inverse = exposure.v[1];
  uint plane = place.width * place.height;
  uvec2 own = min(id, uvec2(p.frame_width, p.frame_height) - 1);
  Around near = around(own);
  History history = history_of(own, place, plane, near);
  vec2 factors = vec2(1.0);
  if (p.inverse_scale > 0.0) factors = factors_at(own);
  float frames = min(history.frames * factors.y, RAYMELD_MOST_FRAMES - 1.0);
  float share = 1.0 / (frames + 1.0);
  float guide_share = max(share, min(0.5 * history.blur, RAYMELD_SHARPENED_SHARE));

  uvec2 core = own - uvec2(place.core_x, place.core_y);
  bool is_kept = id == own && core.x < place.core_width && core.y < place.core_height;
  uint element = (own.y + place.y) * place.width + own.x + place.x;
  vec3 light = vec3(0.0);
  for (uint step = 0; step < p.channels; ++step) {
    // Albedo comes before the color, which is multiplied by it.
    uint c = step < 6 ? step + 3 : step < 9 ? step - 6 : step;
    bool is_color = c < kGuides, is_radiance = is_color || c >= kRadiance;
    float past = 0.0;
    [[unroll]] for (uint i = 0; i < 4; ++i)
      past += history.shares[i] * last.v[c * plane + history.elements[i]];
    if (is_radiance) past *= factor * factors.x;
    float value = is_radiance ? linear_at(c, own) : hrls_at(c, own);
    if (is_color) value = value * near.firefly / (hrls_at(kGuides + c, own) + RAYMELD_ALBEDO_FLOOR);
    // The history's radiance may be so bright that a difference from it would leave nothing of this frame's.
    float joined = is_radiance ? share * (frames * past + value) : past + guide_share * (value - past);
    if (frames <= 0.0) joined = value;
    if (is_kept) next.v[c * plane + element] = is_radiance ? joined * inverse : joined;
    if (c >= kGuides && c < kGuides + 3) light[c - kGuides] = joined + RAYMELD_ALBEDO_FLOOR;
    if (is_color) joined *= light[c];
    if (is_radiance) joined = to_network(min(joined, p.clip), p.log_transfer);
    target.v[address(c, id.y, id.x, p.plane, p.width)] = STORAGE(storable(joined));
  }
  if (is_kept) {
    next.v[p.channels * plane + element] = history.motion.x;
    next.v[(p.channels + 1) * plane + element] = history.motion.y;
    next.v[(p.channels + 2) * plane + element] = p.has_depth != 0 ? frame_value(p.motion, 2, own) : 0.0;
    next.v[(p.channels + 3) * plane + element] = frames + 1.0;
  }
  float samples = clamp((frames + 1.0) * p.spp, 1.0, RAYMELD_MOST_SAMPLES);
  target.v[address(p.count_channel, id.y, id.x, p.plane, p.width)] = STORAGE(storable(log2(samples)));
  count_saturated();
}
