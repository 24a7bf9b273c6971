// Returns the sum over a workgroup's invocations to all of them. It adds in a fixed tree, so that the
// sum always has the same bits.
layout(local_size_x = RAYMELD_SUMMANDS) in;
#include "invocation.glsl"
shared float summands[RAYMELD_SUMMANDS];

float workgroup_sum(float summand) {
  uint self = local_invocation_index();
  summands[self] = summand;
  barrier();
  [[unroll]] for (uint count = RAYMELD_SUMMANDS / 2; count > 0; count /= 2) {
    if (self < count) summands[self] += summands[self + count];
    barrier();
  }
  return summands[0];
}
