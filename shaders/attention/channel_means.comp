// Writes the mean of each channel. A workgroup sums up a channel, of which an invocation takes every
// RAYMELD_SUMMANDS-th pixel, always in the same order.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "workgroup_sum.glsl"

layout(push_constant) uniform Push {
  ADDRESS(Values, source) ADDRESS(Values, target)
  ChannelMeans p;
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, writeonly, Target, STORAGE, target)

void main() {
  uint self = local_invocation_index(), channel = gl_WorkGroupID.z;
  float sum = 0.0;
  for (uint i = self; i < p.pixels; i += RAYMELD_SUMMANDS) sum += float(source.v[channel * p.plane_in + i]);
  sum = workgroup_sum(sum);
  if (self == 0) target.v[channel * p.plane] = STORAGE(storable(sum / float(p.pixels)));
  count_saturated();
}
