// Declares the bindings and the addressing of all passes.
#include "params.h"

layout(local_size_x = kGroup, local_size_y = kGroup) in;

layout(std430, binding = kConstants) readonly buffer ConstantsBlock { Constants constants; };
layout(std430, binding = kLrhs) buffer LrhsBlock { float lrhs[]; };
layout(std430, binding = kHrls) buffer HrlsBlock { float hrls[]; };
layout(std430, binding = kMotion) writeonly buffer MotionBlock { float motion[]; };
layout(std430, binding = kFused) readonly buffer FusedBlock { float fused[]; };
layout(std430, binding = kAccumulated) buffer AccumulatedBlock { float accumulated[]; };
layout(binding = kShown, rgba32f) uniform image2D shown;

ivec2 full_size() { return ivec2(constants.width, constants.height); }
ivec2 small_size() { return full_size() / int(constants.scale); }

bool inside(ivec2 pixel, ivec2 size) { return all(lessThan(pixel, size)); }

// Returns the index of a pixel of channel c in a planar image.
uint at(uint c, ivec2 pixel, ivec2 size) { return (c * size.y + pixel.y) * size.x + pixel.x; }

// Maps light to [0, 1) as the eye takes it.
vec3 tone(vec3 light) { return 1 - exp(-max(light, 0)); }

vec3 srgb(vec3 x) {
  return mix(12.92 * x, 1.055 * pow(max(x, 0.0031308), vec3(1 / 2.4)) - 0.055,
             greaterThan(x, vec3(0.0031308)));
}

// Returns the direction to a point of the image, given in pixels from the top-left corner.
vec3 direction_of(Camera camera, vec2 point, vec2 size) {
  const vec2 ndc = 2 * point / size - 1;
  return normalize(camera.forward.xyz + ndc.x * camera.right.xyz - ndc.y * camera.up.xyz);
}

// Returns where a point of the world is in the image, in pixels; z is its depth along `forward`.
vec3 project(Camera camera, vec3 point, vec2 size) {
  const vec3 to = point - camera.position.xyz;
  const float depth = dot(to, camera.forward.xyz);
  const vec3 right = camera.right.xyz, up = camera.up.xyz;
  const vec2 ndc = vec2(dot(to, right) / dot(right, right), -dot(to, up) / dot(up, up)) / depth;
  return vec3((ndc + 1) / 2 * size, depth);
}
