// Computes a variance. color_at(ivec2) must be declared before; it replicates the edges.

// Returns for each channel the mean over 3x3 pixels of the squared difference from their mean.
vec3 variance_at(ivec2 own) {
  const float kShare = 1.0 / 9.0;
  vec3 colors[9], mean = vec3(0.0), squares = vec3(0.0);
  [[unroll]] for (int i = 0; i < 9; ++i) {
    colors[i] = color_at(own + ivec2(i % 3, i / 3) - 1);
    mean += colors[i] * kShare;  // the sum of nine colors could overflow
  }
  [[unroll]] for (int i = 0; i < 9; ++i) squares += (colors[i] - mean) * (colors[i] - mean);
  return squares * kShare;
}
