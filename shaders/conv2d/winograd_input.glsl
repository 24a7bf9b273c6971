// Transforms the input in winograd_input.comp and llvmpipe/winograd_input_vectors.comp. It must be
// included after winograd.glsl.

// Computes B^T d in place, of two columns or rows at once.
void transform(inout vec2 d[kMostSide]) {
  if (kSide == 4) {
    vec2 d1 = d[1];
    d[0] -= d[2];
    d[3] = d1 - d[3];
    d[1] = d1 + d[2];
    d[2] -= d1;
  } else if (kSide == 6) {
    vec2 even = d[4] - 4.0 * d[2], odd = d[3] - 4.0 * d[1];
    vec2 near = d[4] - d[2], far = 2.0 * (d[3] - d[1]);
    d[0] = 4.0 * d[0] - 5.0 * d[2] + d[4];
    d[5] = 4.0 * d[1] - 5.0 * d[3] + d[5];
    d[1] = even + odd;
    d[2] = even - odd;
    d[3] = near + far;
    d[4] = near - far;
  }
}
