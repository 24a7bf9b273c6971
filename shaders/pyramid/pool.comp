// Writes the means of 2 x 2 pixels of light, which has three channels, and then of guides. With a share, the
// light is moved towards another image of the smaller size. Each invocation computes one element; z is the
// channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
layout(constant_id = 0) const bool kHasShares = false;  // each pixel has its own
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, light) ADDRESS(Values, guides) ADDRESS(Values, other) ADDRESS(Values, shares)
  ADDRESS(Values, target)
  Pool p;
};
BUFFER(1, readonly, Lights, STORAGE, light)
BUFFER(2, readonly, Guides, STORAGE, guides)
BUFFER(3, readonly, Other, STORAGE, other)
BUFFER(4, readonly, Shares, STORAGE, shares)
BUFFER(5, writeonly, Target, STORAGE, target)

const uint kLightChannels = 3;

float source_at(uint c, uint y, uint x) {
  uint pixel = address(0, y, x, p.plane_large, 2 * p.width);
  return c < kLightChannels ? float(light.v[pixel + c * p.plane_large])
                            : float(guides.v[pixel + (c - kLightChannels) * p.plane_large]);
}

void main() {
  uvec3 id = global_invocation_id();
  if (id.x >= p.width || id.y >= p.height) return;
  uint y = 2 * id.y, x = 2 * id.x, element = address(id.z, id.y, id.x, p.plane, p.width);
  float mean = (source_at(id.z, y, x) + source_at(id.z, y, x + 1) + source_at(id.z, y + 1, x) +
                source_at(id.z, y + 1, x + 1)) /
               4.0;
  float share = p.share;
  if (kHasShares) share = float(shares.v[address(0, id.y, id.x, p.plane, p.width)]);
  if (share > 0.0 && id.z < kLightChannels) mean += share * (float(other.v[element]) - mean);
  target.v[element] = STORAGE(storable(mean));
  count_saturated();
}
