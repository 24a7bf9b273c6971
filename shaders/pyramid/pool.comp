// Writes the means of 2 x 2 pixels of light, the first three channels, and of guides, the last six. With a
// share, the light is moved towards another image of the smaller size. Each invocation computes one element;
// z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
layout(constant_id = 0) const bool kHasShares = false;  // each pixel has its own
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, source) ADDRESS(Values, other) ADDRESS(Values, shares) ADDRESS(Values, target)
  Pool p;
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, readonly, Other, STORAGE, other)
BUFFER(3, readonly, Shares, STORAGE, shares)
BUFFER(4, writeonly, Target, STORAGE, target)

const uint kLightChannels = 3;

float source_at(uint c, uint y, uint x) {
  return float(source.v[address(c, y, x, p.plane_large, 2 * p.width)]);
}

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= p.width || id.y >= p.height) return;
  uint y = 2 * id.y, x = 2 * id.x, element = address(id.z, id.y, id.x, p.plane, p.width);
  uint c = id.z < kLightChannels ? id.z : id.z + p.skipped;
  float mean = (source_at(c, y, x) + source_at(c, y, x + 1) + source_at(c, y + 1, x) +
                source_at(c, y + 1, x + 1)) /
               4.0;
  float share = p.share;
  if (kHasShares) share = float(shares.v[address(0, id.y, id.x, p.plane, p.width)]);
  if (share > 0.0 && id.z < kLightChannels) mean += share * (float(other.v[element]) - mean);
  target.v[element] = STORAGE(storable(mean));
  count_saturated();
}
