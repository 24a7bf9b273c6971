// Computes the first of three steps of a Winograd convolution: B^T d B of every tile and channel of a band of
// rows, with zeros outside the image. With kUnshuffle r > 1 the convolution reads space_to_depth() by r of
// the bound image. Each invocation transforms two tiles side by side; z is the channel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "winograd.glsl"
#include "winograd_transforms.glsl"

layout(local_size_x = 32) in;
#include "invocation.glsl"
layout(constant_id = 1) const uint kUnshuffle = 1;
layout(constant_id = 2) const uint kPairs = 0;  // rows of the source are read in pairs, as the width is even
layout(push_constant) uniform Push {
  ADDRESS(Values, source)
  ADDRESS(Pairs, transformed)
  WinogradInput p;
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, writeonly, Transformed, float, transformed)
#include "tile_pair.glsl"

float load(uint c, uint y, uint x) {
  bool inside = y < p.height && x < p.width;
  uvec3 place = shuffled(kUnshuffle, c, y, x);
  uint at = address(place.x, place.y & p.rows_mask, place.z, p.plane, kUnshuffle * p.width);
  float value = float(source.v[inside ? at : 0]);
  return inside ? value : 0.0;
}

// Returns the values at x and x + 1, where x and the width are even.
vec2 load_pair(uint c, uint y, uint x) {
  bool inside = y < p.height && x < p.width;
  uint at = address(c, y & p.rows_mask, x, p.plane, p.width);
  vec2 values = READ_VALUES(source, inside ? at : 0);
  return inside ? values : vec2(0.0);
}

void main() {
  uint tile = 2 * global_invocation_id().x, channel = global_invocation_id().z;
  uvec2 corner = pair_corner(p.first_tile_row, p.tiles_x);
  // Unsigned numbers wrap around above and left of the image, to far outside of it. With kPairs x0 is odd.
  uint y0 = corner.y + p.first_y, x0 = corner.x + p.first_x;
  float columns[kMostSide][2 * kMostSide];  // [row][column] of both tiles
  vec2 even[kMostSide];                     // the columns x0 + x - 1 and x0 + x
  [[unroll]] for (uint y = 0; y < kSide; ++y)
    even[y] = kPairs != 0 ? load_pair(channel, y0 + y, x0 - 1) : vec2(0.0);
  [[unroll]] for (uint x = 0; x < kSide + kTile; x += 2) {
    vec2 d[kMostSide];
    [[unroll]] for (uint y = 0; y < kSide; ++y) {
      if (kPairs != 0) {
        vec2 next = load_pair(channel, y0 + y, x0 + x + 1);
        d[y] = vec2(even[y].y, next.x);
        even[y] = next;
      } else {
        d[y] = vec2(load(channel, y0 + y, x0 + x), load(channel, y0 + y, x0 + x + 1));
      }
    }
    transform_input(d);
    [[unroll]] for (uint y = 0; y < kSide; ++y) {
      columns[y][x] = d[y].x;
      columns[y][x + 1] = d[y].y;
    }
  }
  uint at = element(0, p.first_channel + channel, tile, p.position_stride, p.channels);
  [[unroll]] for (uint y = 0; y < kSide; ++y) {
    vec2 d[kMostSide];
    [[unroll]] for (uint x = 0; x < kSide; ++x) d[x] = vec2(columns[y][x], columns[y][x + kTile]);
    transform_input(d);
    [[unroll]] for (uint x = 0; x < kSide; ++x)
      WRITE_PAIR(transformed, at + (y * kSide + x) * p.position_stride, d[x]);
  }
}
