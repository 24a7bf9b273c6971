// Computes the same as joint_filter.comp on drivers that make vectors of kVector
// invocations: see vector.glsl.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#define VECTOR_PUSH uint digits[4];
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
layout(constant_id = 0) const uint kVector = 8;
#include "invocation.glsl"
#include "joint_filter.glsl"
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"

// Names the pixel of a row that lies dx steps beside the invocation's column, `own`, edges being replicated;
// `first` is the column where the invocation's vector starts.
struct Site {
  uint row, own, first;
  int dx;
};

// Reads a vector, parts of which may lie beyond the row, and even beyond all tensors.
float read(Floats from, uint channel, Site at) {
  uint64_t row = uint64_t(from) + 4ul * address(channel, at.row, 0, p.plane, p.width);
  float value = read_vector(Floats(row + uint64_t(int64_t(4 * (int(at.first) + at.dx * int(p.step))))), 0);
  if (at.dx == 0) return value;
  float edge = Floats(row).v[at.dx < 0 ? 0 : p.width - 1];  // lanes would read it one by one in a branch
  int column = int(at.own) + at.dx * int(p.step);
  return column < 0 || column >= int(p.width) ? edge : value;
}

Tap tap_at(Site at) {
  return Tap(Surface(vec3(read(albedo, 0, at), read(albedo, 1, at), read(albedo, 2, at)),
                     vec3(read(normal, 0, at), read(normal, 1, at), read(normal, 2, at))),
             read(brightness, 0, at));
}

void main() {
  uvec2 id = global_invocation_id().xy, first = first_of_vector();
  uint phase = first.y & (p.step - 1), top = (first.y - phase) * kStrip + phase;
  Tap own[kStrip];
  Sums sums[kStrip];
  [[unroll]] for (int k = 0; k < kStrip; ++k) {
    own[k] = tap_at(Site(row_of(top, k), id.x, first.x, 0));
    sums[k] = Sums(vec3(0.0), 0.0, 0.0);
  }
  [[unroll]] for (int row = -1; row <= kStrip; ++row) {
    [[unroll]] for (int dx = -1; dx <= 1; ++dx) {
      Site at = Site(row_of(top, row), id.x, first.x, dx);
      Tap tap;
      if (dx == 0 && row >= 0 && row < kStrip) {
        tap = own[row];
      } else {
        tap = tap_at(at);
      }
      vec4 value = vec4(read(source, 0, at), read(source, 1, at), read(source, 2, at), read(source, 3, at));
      [[unroll]] for (int dy = -1; dy <= 1; ++dy) {
        int of = row - dy;
        if (of >= 0 && of < kStrip) add(sums[of], own[of], tap, value, binomial(dx, dy));
      }
    }
    float all = 0.0;
    [[unroll]] for (uint k = 0; k < kStrip; ++k) all += sums[k].weight + sums[k].certainty + sums[k].light.x;
    keep_order(all);
  }
  if (end_order()) return;
  [[unroll]] for (uint k = 0; k < kStrip; ++k) store(uvec2(id.x, top + k * p.step), sums[k]);
  count_saturated();
}
