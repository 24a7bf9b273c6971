// Transforms the weights before the three steps of a Winograd convolution: G g G^T of every pair of
// channels. Each invocation computes two, which are neighbours in the layout that winograd_multiply.comp
// reads: [position][block][in][output]. Filters have the layout [3 x 3][block][in][output]. p.count is the
// number of elements from one of the 9 taps, or from one position, to the next, and a multiple of the
// elements that a workgroup computes.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "winograd.glsl"

layout(local_size_x = 64) in;
#include "invocation.glsl"
layout(push_constant) uniform Push {
  ADDRESS(Values, filters)
  ADDRESS(Pairs, transformed)
  WinogradWeights p;
};
BUFFER(1, readonly, Filters, STORAGE, filters)
BUFFER(2, writeonly, Transformed, float, transformed)

vec2 load(uint at) { return READ_VALUES(filters, at); }

// Computes G g of a column or a row of two filters. `precise` rounds each product with a multiple of 1/24 to
// nearest by itself, so that results that are whole numbers are exact, as tests ask. A division might not be,
// nor would two products that a compiler fused.
void transform(vec2 g0, vec2 g1, vec2 g2, out vec2 u[kMostSide]) {
  vec2 outer = g0 + g2;
  u[0] = g0;
  if (kSide == 4) {
    u[1] = 0.5 * (outer + g1);
    u[2] = 0.5 * (outer - g1);
  } else {
    precise vec2 far = (g0 + 4.0 * g2) * (1.0 / 24.0), middle = g1 * (1.0 / 12.0);
    precise vec2 sum = (outer + g1) * (-1.0 / 6.0), difference = (outer - g1) * (-1.0 / 6.0);
    u[0] = 0.25 * g0;
    u[1] = sum;
    u[2] = difference;
    u[3] = far + middle;
    u[4] = far - middle;
  }
  u[kSide - 1] = g2;
}

void main() {
  uint at = 2 * global_invocation_id().x;
  vec2 columns[kKernel][kMostSide];  // [column of g][row of G g]
  [[unroll]] for (uint x = 0; x < kKernel; ++x)
    transform(load(at + x * p.count), load(at + (kKernel + x) * p.count),
              load(at + (2 * kKernel + x) * p.count), columns[x]);
  [[unroll]] for (uint y = 0; y < kSide; ++y) {
    vec2 row[kMostSide];
    transform(columns[0][y], columns[1][y], columns[2][y], row);
    [[unroll]] for (uint x = 0; x < kSide; ++x)
      WRITE_PAIR(transformed, at + (y * kSide + x) * p.count, row[x]);
  }
}
