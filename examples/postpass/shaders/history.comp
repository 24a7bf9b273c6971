// Blends the fused image with what it was in the frames before, at the place where this pixel's surface was then.
//
// Motion is that of the first surface at the pixel's centre. A neighbour of that place in the last frame is taken as far
// as its depth and normal agree, and the mean of those is moved to where this frame's neighbourhood makes it likely
// (variance clipping, Salvi 2016). All means are of toned light, so that a bright pixel counts no more than it shows.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"
#include "scene.glsl"

vec3 fused_at(ivec2 pixel, ivec2 size) {
  return tone(vec3(fused[at(0, pixel, size)], fused[at(1, pixel, size)], fused[at(2, pixel, size)]));
}

const float kSnap = 1e-3;  // pixels of motion, and weights, that are none

// Catmull-Rom weights of the four samples around a place between the middle two.
vec4 cubic(float x) {
  return vec4(((2 - x) * x - 1) * x, (3 * x - 5) * x * x + 2, ((4 - 3 * x) * x + 1) * x, (x - 1) * x * x) / 2;
}

void main() {
  const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = full_size();
  if (!inside(pixel, size)) return;
  const Ray ray = Ray(constants.camera.position.xyz, direction_of(constants.camera, pixel + 0.5, vec2(size)));
  const Hit hit = intersect(ray);
  const vec3 point = ray.origin + hit.t * ray.direction;
  const float depth = hit.t * dot(ray.direction, constants.camera.forward.xyz);
  const uint slot = constants.slot, last = 1 - slot;
  guides[slot_at(slot, pixel, size)] = vec4(hit.normal, depth);

  const vec3 now = fused_at(pixel, size);
  vec3 mean = vec3(0), square = vec3(0);
  for (int i = 0; i < 9; ++i) {
    const vec3 near = fused_at(clamp(pixel + ivec2(i % 3, i / 3) - 1, ivec2(0), size - 1), size);
    mean += near / 9;
    square += near * near / 9;
  }
  const vec3 deviation = sqrt(max(square - mean * mean, 0));

  // By a cubic filter, kept from ringing; and, with the number of frames, by a linear one of what agrees, for where not
  // all of it does.
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
