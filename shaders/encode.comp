// From a frame's image (scene linear) to the network's input. NaN becomes 0; infinities meet the clamps. Channels that
// are one value everywhere are in no image.
// One invocation for RAYMELD_ENCODE_STRIP elements below each other, which depend on nothing but themselves, so that a device
// need not wait for the logarithm of each; z is the channel.
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

const uint kStrip = RAYMELD_ENCODE_STRIP;

void main() {
  uvec3 id = global_invocation_id();
  uvec2 pixels[kStrip];
  // Selections rather than branches, in which drivers for CPUs load lane by lane.
  bool wanted[kStrip], any = false;
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    uvec2 pixel = uvec2(id.x, kStrip * id.y + k);
    pixels[k] = min(pixel, uvec2(p.width, p.height) - 1);
    wanted[k] = pixel == pixels[k] && !is_left_out(pixels[k]);
    any = any || wanted[k];
  }
  if (kBlockSide != 0 && !any) return;
  uint channel = p.channels[id.z / 4] >> id.z % 4 * 8 & 255, kind = channel & 3, source = channel >> 2;
  bool constant = source >= RAYMELD_FIRST_CONSTANT;
  bool light = kind == RAYMELD_RADIANCE || kind == RAYMELD_VARIANCE;
  float low = kind == RAYMELD_NORMAL ? -1.0 : 0.0, high = light ? p.clip : 1.0;
  float factor = exposure.v[0];
  factor = light ? factor * (kind == RAYMELD_VARIANCE ? factor : 1.0) : 1.0;
  float values[kStrip];
  [[unroll]] for (uint k = 0; k < kStrip; ++k) values[k] = frame_value(p.frame, constant ? 0 : source, pixels[k]) * factor;
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    // Comparisons rather than min and max, whose result for NaN is undefined in GLSL.
    float value = isnan(values[k]) ? 0.0 : values[k];
    value = value >= low ? value : low;
    value = value > high ? high : value;
    if (p.log_transfer != 0) value = light ? to_network(value, 1) : value;
    values[k] = constant ? p.constants[source % 8] : value;
  }
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    if (wanted[k]) target.v[address(id.z, pixels[k].y, id.x, p.plane, p.width)] = STORAGE(storable(values[k]));
  }
}
