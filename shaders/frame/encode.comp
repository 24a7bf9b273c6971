// Encodes channels of a frame's image (scene linear) for the network. NaN becomes 0, and infinities are
// clamped. Channels that are one value everywhere are in no image: their encoded values are push constants.
// Each invocation encodes a strip of elements, which are independent, so that a device need not wait for the
// logarithm of each; z is the channel. With FRAME_IMAGE it encodes the three channels that it fetches.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "transfer.glsl"
#include "finite.glsl"
#include "frame.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Floats, exposure)
  ADDRESS(Values, target)
  Encode p;
};
BUFFER(2, readonly, Exposure, float, exposure)
BUFFER(3, writeonly, Target, STORAGE, target)
#include "strip.glsl"

#ifdef FRAME_IMAGE
const uint kChannels = 3;
#else
const uint kChannels = 1;
#endif

void main() {
  uvec3 id = global_invocation_id();
  Strip strip = strip_at(id.xy, uvec2(p.width, p.height));
  uvec2 pixels[kStrip];  // those of the image
  [[unroll]] for (uint k = 0; k < kStrip; ++k)
    pixels[k] = min(strip.pixels[k], uvec2(p.frame_width, p.frame_height) - 1);
#ifdef FRAME_IMAGE
  vec4 texels[kStrip];
  [[unroll]] for (uint k = 0; k < kStrip; ++k) texels[k] = frame_texel(p.frame, pixels[k]);
#endif
  [[unroll]] for (uint c = 0; c < kChannels; ++c) {
    uint to = kChannels * id.z + c, channel = p.channels[to / 4] >> to % 4 * 8 & 255;
    uint kind = channel & 3, source = channel >> 2;
    bool constant = source >= RAYMELD_FIRST_CONSTANT;
    bool light = kind == RAYMELD_RADIANCE || kind == RAYMELD_VARIANCE;
    float low = kind == RAYMELD_NORMAL ? -1.0 : 0.0, high = light ? p.clip : 1.0;
    float factor = exposure.v[0];
    factor = light ? factor * (kind == RAYMELD_VARIANCE ? factor : 1.0) : 1.0;
    float values[kStrip];
    [[unroll]] for (uint k = 0; k < kStrip; ++k) {
#ifdef FRAME_IMAGE
      values[k] = texels[k][source % 4] * factor;
#else
      values[k] = frame_value(p.frame, constant ? 0 : source, pixels[k]) * factor;
#endif
    }
    [[unroll]] for (uint k = 0; k < kStrip; ++k) {
      // Compares instead of calling min and max, whose result for NaN is undefined in GLSL.
      float value = is_nan(values[k]) ? 0.0 : values[k];
      value = value >= low ? value : low;
      value = value > high ? high : value;
      if (p.log_transfer != 0) value = light ? to_network(value, 1) : value;
      values[k] = constant ? p.constants[source % 8] : value;
    }
    [[unroll]] for (uint k = 0; k < kStrip; ++k) {
      if (strip.wanted[k])
        target.v[address(to, strip.pixels[k].y, id.x, p.plane, p.width)] = STORAGE(storable(values[k]));
    }
  }
  count_saturated();
}
