// Blends the fused image with its history, taken where the pixel's surface was in the last frame.
//
// Motion is that of the first surface at the pixel's centre. Neighbours of the surface's place in the last
// frame count only if their depth and normal agree, and their mean is clamped to the range that this frame's
// neighbourhood makes likely (variance clipping, Salvi 2016). All means are of toned light, so that a bright
// pixel counts no more than it shows. An invocation goes down a strip of pixels, so that it tones each row
// once for the three rows that the row is a neighbour of.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"
#include "scene.glsl"

vec3 fused_at(ivec2 pixel, ivec2 size) {
  return tone(vec3(fused[at(0, pixel, size)], fused[at(1, pixel, size)], fused[at(2, pixel, size)]));
}

const float kSnap = 1e-3;  // motion, in pixels, and weights below this count as none

// Returns the Catmull-Rom weights of four samples around a place between the middle two.
vec4 cubic(float x) {
  return vec4(((2 - x) * x - 1) * x, (3 * x - 5) * x * x + 2, ((4 - 3 * x) * x + 1) * x, (x - 1) * x * x) / 2;
}

// Holds sums over three pixels side by side, edges replicated, and the pixel in the middle.
struct Row {
  vec3 middle, sum, square;
};

Row row_at(ivec2 pixel, ivec2 size) {
  Row row = Row(vec3(0), vec3(0), vec3(0));
  for (int i = 0; i < 3; ++i) {
    const vec3 near = fused_at(clamp(pixel + ivec2(i - 1, 0), ivec2(0), size - 1), size);
    if (i == 1) row.middle = near;
    row.sum += near;
    row.square += near * near;
  }
  return row;
}

// Blends a pixel; `mean` and `deviation` are those of the 3x3 pixels around it.
void blend(ivec2 pixel, ivec2 size, vec3 now, vec3 mean, vec3 deviation) {
  const Ray ray = Ray(constants.camera.position.xyz, direction_of(constants.camera, pixel + 0.5, vec2(size)));
  const Hit hit = intersect(ray);
  const vec3 point = ray.origin + hit.t * ray.direction;
  const float depth = hit.t * dot(ray.direction, constants.camera.forward.xyz);
  const uint slot = constants.slot, last = 1 - slot;
  guides[slot_at(slot, pixel, size)] = vec4(hit.normal, depth);

  // A cubic filter, clamped to keep it from ringing, gives the color where all neighbours agree. Elsewhere a
  // linear filter of those that agree gives it. The number of frames always comes from the linear filter.
  vec3 cubic_sum = vec3(0), low = vec3(1), high = vec3(0);
  vec4 linear_sum = vec4(0);
  float linear_weight = 0;
  bool all_agree = true;
  const vec3 place = project(constants.last_camera, point, vec2(size));
  if (constants.history_frames > 0 && place.z > 0) {
    const vec2 corner = floor(place.xy - 0.5 + kSnap);
    const vec2 part = max(place.xy - 0.5 - corner, 0);
    const vec4 wx = cubic(part.x), wy = cubic(part.y);
    for (int i = 0; i < 16; ++i) {
      const ivec2 to = ivec2(i % 4, i / 4) - 1, near = ivec2(corner) + to;
      const float weight = wx[i % 4] * wy[i / 4];
      if (abs(weight) < kSnap) continue;
      if (any(lessThan(near, ivec2(0))) || !inside(near, size)) {
        all_agree = false;
        continue;
      }
      const vec4 value = history[slot_at(last, near, size)];
      cubic_sum += weight * value.rgb;
      if (any(lessThan(to, ivec2(0))) || any(greaterThan(to, ivec2(1)))) continue;
      const vec4 guide = guides[slot_at(last, near, size)];
      if (dot(guide.xyz, hit.normal) < 0.8 || abs(guide.w - place.z) > 0.03 * place.z + 0.01) {
        all_agree = false;
        continue;
      }
      low = min(low, value.rgb);
      high = max(high, value.rgb);
      const vec2 linear = mix(1 - part, part, vec2(to));
      linear_sum += linear.x * linear.y * value;
      linear_weight += linear.x * linear.y;
    }
  }
  vec3 blended = now;
  float frames = 0;
  if (linear_weight > 0.1) {
    const vec4 linear = linear_sum / linear_weight;
    const vec3 before = all_agree ? clamp(cubic_sum, low, high) : linear.rgb;
    const vec3 tolerance = deviation + constants.history_tolerance;
    const vec3 kept = clamp(before, mean - tolerance, mean + tolerance);
    frames = clamp(linear.w, 0, float(constants.history_frames));
    blended = mix(kept, now, max(constants.history_weight, 1 / (frames + 1)));
  }
  history[slot_at(slot, pixel, size)] = vec4(blended, frames + 1);
}

void main() {
  const ivec2 size = full_size();
  ivec2 pixel = strip_start();
  Row above = row_at(pixel - ivec2(0, 1), size), own = row_at(pixel, size);
  for (uint i = 0; i < kStrip; ++i) {
    const Row below = row_at(pixel + ivec2(0, 1), size);
    const vec3 mean = (above.sum + own.sum + below.sum) / 9;
    const vec3 square = (above.square + own.square + below.square) / 9;
    if (inside(pixel, size)) blend(pixel, size, own.middle, mean, sqrt(max(square - mean * mean, 0)));
    above = own;
    own = below;
    ++pixel.y;
  }
}
