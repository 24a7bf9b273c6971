// From a frame's image (scene linear) to the network's input. NaN becomes 0; infinities meet the clamps. Channels that
// are one value everywhere are in no image.
// One invocation for each element; z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "frame.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Floats exposure;
  Values target;
  Encode p;
};
#else
layout(push_constant) uniform Push { Encode p; };
layout(std430, binding = 2) readonly buffer Exposure { float v[2]; } exposure;
layout(std430, binding = 3) writeonly buffer Target { STORAGE v[]; } target;
#endif
#include "left_out.glsl"

void main() {
  uvec3 id = global_invocation_id();
  // Selections rather than branches, in which drivers for CPUs load lane by lane.
  bool inside = id.x < p.width && id.y < p.height;
  if (is_left_out(min(id.xy, uvec2(p.width, p.height) - 1))) return;
  uint channel = p.channels[id.z / 4] >> id.z % 4 * 8 & 255, kind = channel & 3, source = channel >> 2;
  bool constant = source >= RAYMELD_FIRST_CONSTANT;
  bool light = kind == RAYMELD_RADIANCE || kind == RAYMELD_VARIANCE;
  float low = kind == RAYMELD_NORMAL ? -1.0 : 0.0, high = light ? p.clip : 1.0;
  float factor = exposure.v[0];
  float value = frame_value(p.frame, constant ? 0 : source, min(id.xy, uvec2(p.width, p.height) - 1)) *
                (light ? factor * (kind == RAYMELD_VARIANCE ? factor : 1.0) : 1.0);
  // Comparisons rather than min and max, whose result for NaN is undefined in GLSL.
  value = isnan(value) ? 0.0 : value;
  value = value >= low ? value : low;
  value = value > high ? high : value;
  if (p.log_transfer != 0) value = light ? to_network(value, 1) : value;
  value = constant ? p.constants[source % 8] : value;
  if (inside) target.v[address(id.z, id.y, id.x, p.plane, p.width)] = STORAGE(storable(value));
}
