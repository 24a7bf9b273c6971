// Multiplies each channel by 1 / (1 + exp(-logit)) and adds a residual. Each invocation computes a strip of
// pixels; z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "share.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, source) ADDRESS(Values, logits) ADDRESS(Values, residual) ADDRESS(Values, target)
  Attend p;
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, readonly, Logits, STORAGE, logits)
BUFFER(3, readonly, Residual, STORAGE, residual)
BUFFER(4, writeonly, Target, STORAGE, target)
#include "strip.glsl"

void main() {
  uvec3 id = global_invocation_id();
  Strip strip = strip_at(id.xy, uvec2(p.width, p.height));
  float share = share_of(float(logits.v[id.z * p.plane_logits]));
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    uint element = address(id.z, strip.pixels[k].y, strip.pixels[k].x, p.plane, p.width);
    float value = share * float(source.v[element]) + float(residual.v[element]);
    if (strip.wanted[k]) target.v[element] = STORAGE(storable(value));
  }
  count_saturated();
}
