// Unrolls the loops whose length no compiler knows: a trip of the loop computes kUnroll steps. Frames are
// computed with 1. Compiled with 2, a kernel shows what a step takes: see raymeld compile.
layout(constant_id = 30) const uint kUnroll = 1;

#define FOR_EACH(i, count)                                         \
  for (uint i##_trip = 0; i##_trip < (count); i##_trip += kUnroll) \
  [[unroll]] for (uint i = i##_trip, i##_step = 0; i##_step < kUnroll; ++i, ++i##_step)
