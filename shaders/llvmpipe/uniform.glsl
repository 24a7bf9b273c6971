// Returns n, which is uniform and below 4096, in a form that drivers know to be uniform. Drivers that find
// out by themselves which values are the same for all lanes know that push constants are, whatever their
// index: digits[i], of VECTOR_PUSH, is i. It must be included after the push constants.
uint uniform_number(uint n) {
  uint number = 0;
  [[unroll]] for (uint shift = 0; shift < 12; shift += 2) number |= digits[n >> shift & 3] << shift;
  return number;
}
