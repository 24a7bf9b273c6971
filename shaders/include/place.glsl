// Reads where a recording lies in its frame, from `exposure`, which must be declared before.
Place place_of_recording() {
  uint at[8];
  [[unroll]] for (uint i = 0; i < 8; ++i) at[i] = uint(exposure.v[2 + i]);
  return Place(at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7]);
}
