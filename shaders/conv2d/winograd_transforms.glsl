// Has the transforms of inputs and sums. It must be included after winograd.glsl.

// Computes B^T d in place, of two columns or rows at once.
void transform_input(inout vec2 d[kMostSide]) {
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

// Computes A^T m in place, of two columns or rows at once; the first kTile elements are the result.
void transform_sums(inout vec2 m[kMostSide]) {
  if (kSide == 4) {
    m[0] += m[1] + m[2];
    m[1] -= m[2] + m[3];
  } else if (kSide == 6) {
    vec2 sum = m[1] + m[2], difference = m[1] - m[2], sum2 = m[3] + m[4], difference2 = m[3] - m[4];
    m[0] += sum + sum2;
    m[1] = difference + 2.0 * difference2;
    m[2] = sum + 4.0 * sum2;
    m[3] = difference + 8.0 * difference2 + m[5];
  }
}
