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

uint slot_at(uint slot, uint c, ivec2 pixel, ivec2 size) { return at(4 * slot + c, pixel, size); }

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
  for (uint c = 0; c < 3; ++c) guides[slot_at(slot, c, pixel, size)] = hit.normal[c];
  guides[slot_at(slot, 3, pixel, size)] = depth;

  const vec3 now = fused_at(pixel, size);
  vec3 mean = vec3(0), square = vec3(0);
  for (int i = 0; i < 9; ++i) {
    const vec3 near = fused_at(clamp(pixel + ivec2(i % 3, i / 3) - 1, ivec2(0), size - 1), size);
    mean += near / 9;
    square += near * near / 9;
  }
  const vec3 deviation = sqrt(max(square - mean * mean, 0));

  vec4 before = vec4(0);  // color and number of frames
  float found = 0, all_weights = 0;
  const vec3 place = project(constants.last_camera, point, vec2(size));
  if (constants.history_frames > 0 && place.z > 0) {
    const vec2 corner = floor(place.xy - 0.5);
    const vec2 part = place.xy - 0.5 - corner;
    const vec4 wx = cubic(part.x), wy = cubic(part.y);
    for (int i = 0; i < 16; ++i) {
      const ivec2 near = ivec2(corner) + ivec2(i % 4, i / 4) - 1;
      const float weight = wx[i % 4] * wy[i / 4];
      if (any(lessThan(near, ivec2(0))) || !inside(near, size) || weight == 0) continue;
      const vec3 normal = vec3(guides[slot_at(last, 0, near, size)], guides[slot_at(last, 1, near, size)],
                               guides[slot_at(last, 2, near, size)]);
      const float distance = abs(guides[slot_at(last, 3, near, size)] - place.z);
      all_weights += abs(weight);
      if (dot(normal, hit.normal) < 0.8 || distance > 0.03 * place.z + 0.01) continue;
      for (uint c = 0; c < 4; ++c) before[c] += weight * history[slot_at(last, c, near, size)];
      found += weight;
    }
  }
  vec3 blended = now;
  float frames = 0;
  if (found > 0.25) {
    before /= found;
    const float moved = length(place.xy - (vec2(pixel) + 0.5));
    const vec3 tolerance = deviation + constants.history_tolerance;
    const vec3 kept = clamp(before.rgb, mean - tolerance, mean + tolerance);
    frames = min(before.w, float(constants.history_frames));
    blended = mix(kept, now, max(constants.history_weight, 1 / (frames + 1)));
  }
  for (uint c = 0; c < 3; ++c) history[slot_at(slot, c, pixel, size)] = blended[c];
  history[slot_at(slot, 3, pixel, size)] = frames + 1;
}
