// What a sparse graph keeps behind the status, see params.h; to be included behind memory.glsl.

// Of LRHS, width and height.
uvec2 sparse_size() { return uvec2(status.words[RAYMELD_SPARSE_WIDTH], status.words[RAYMELD_SPARSE_HEIGHT]); }

// A word whose place is not the same for all lanes.
uint sparse_word(uint at) {
#ifdef DATA_BY_ADDRESS
  return Words(packUint2x32(uvec2(status.words[RAYMELD_SPARSE_ADDRESS], status.words[RAYMELD_SPARSE_ADDRESS + 1]))).v[at];
#else
  return status.words[at];
#endif
}
