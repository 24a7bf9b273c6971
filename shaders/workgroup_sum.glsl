// The sum over a workgroup's invocations by a fixed tree, which has the same bits always; the first invocation has it.
layout(local_size_x = RAYMELD_SUMMANDS) in;
#include "invocation.glsl"
shared float summands[RAYMELD_SUMMANDS];

float workgroup_sum(float summand) {
  uint self = local_invocation_index();
  summands[self] = summand;
  barrier();
  [[unroll]] for (uint half_of_them = RAYMELD_SUMMANDS / 2; half_of_them > 0; half_of_them /= 2) {
    if (self < half_of_them) summands[self] += summands[self + half_of_them];
    barrier();
  }
  return summands[0];
}
