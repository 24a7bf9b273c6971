// From a frame's image (scene linear floats) to the network's input. NaN becomes 0; infinities meet the clamps.
// One invocation for each element; z is the channel, whose kind the table gives.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "transfer.glsl"

layout(local_size_x = 32, local_size_y = 2) in;
layout(push_constant) uniform Push { Encode p; };
layout(std430, binding = 1) readonly buffer Kinds { uint kinds[]; };
layout(std430, binding = 2) readonly buffer Frame { float frame[]; };
layout(std430, binding = 3) writeonly buffer Output { STORAGE out_data[]; };
layout(std430, binding = 4) readonly buffer Exposure { float exposure; };

// Comparisons rather than min and max, whose result for NaN is undefined in GLSL.
float clamp_finite(float value, float low, float high) {
  if (!(value >= low)) return isnan(value) ? 0.0 : low;
  return value > high ? high : value;
}

void main() {
  uvec3 id = gl_GlobalInvocationID;
  if (id.x >= p.width || id.y >= p.height) return;
  uint at = p.frame.offset + id.z * p.frame.channel_stride + id.y * p.frame.row_stride + id.x * p.frame.pixel_stride;
  float value = frame[at];
  uint kind = kinds[id.z];
  if (kind == RAYMELD_ALBEDO) {
    value = clamp_finite(value, 0.0, 1.0);
  } else if (kind == RAYMELD_NORMAL) {
    value = clamp_finite(value, -1.0, 1.0);
  } else {
    value *= kind == RAYMELD_VARIANCE ? exposure * exposure : exposure;
    value = to_network(clamp_finite(value, 0.0, p.clip), p.log_transfer);
  }
  out_data[address(id.z, id.y, id.x, p.plane, p.width)] = STORAGE(storable(value));
}
