// Computes one level of an a-trous filter (Dammertz et al. 2010): the mean of 3x3 pixels `step` apart,
// edges replicated, weighted by a binomial kernel, by how alike their albedo, normal and brightness are,
// and by their certainty, channel 3. The mean certainty is passed on (normalized convolution, Knutsson
// and Westin 1993). Each invocation filters a strip of pixels, `step` apart below one another, which
// share the pixels around them.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
#include "joint_filter.glsl"

// Returns the element of channel 0 in a row, dx steps beside column x, edges being replicated.
uint element_at(uint row, uint x, int dx) {
  return address(0, row, clamp(int(x) + dx * int(p.step), 0, int(p.width) - 1), p.plane, p.width);
}

Tap tap_at(uint i) { return Tap(surface_of(i, p.plane), float(brightness.v[i])); }

void main() {
  uvec2 id = global_invocation_id().xy;
  uint phase = id.y & (p.step - 1), top = (id.y - phase) * kStrip + phase;
  if (!is_inside(uvec2(id.x, top))) return;
  Tap own[kStrip];
  Sums sums[kStrip];
  [[unroll]] for (int k = 0; k < kStrip; ++k) {
    own[k] = tap_at(element_at(row_of(top, k), id.x, 0));
    sums[k] = Sums(vec3(0.0), 0.0, 0.0);
  }
  [[unroll]] for (int row = -1; row <= kStrip; ++row) {
    [[unroll]] for (int dx = -1; dx <= 1; ++dx) {
      uint i = element_at(row_of(top, row), id.x, dx);
      Tap tap;
      if (dx == 0 && row >= 0 && row < kStrip) {
        tap = own[row];
      } else {
        tap = tap_at(i);
      }
      vec4 value =
          vec4(source.v[i], source.v[i + p.plane], source.v[i + 2 * p.plane], source.v[i + 3 * p.plane]);
      [[unroll]] for (int dy = -1; dy <= 1; ++dy) {
        int of = row - dy;
        if (of >= 0 && of < kStrip) add(sums[of], own[of], tap, value, binomial(dx, dy));
      }
    }
  }
  [[unroll]] for (uint k = 0; k < kStrip; ++k) store(uvec2(id.x, top + k * p.step), sums[k]);
  count_saturated();
}
