// Returns the factor, at most 1, that darkens a firefly to RAYMELD_FIREFLY times its second brightest
// neighbour + RAYMELD_FIREFLY_FLOOR. The pixel is in the middle of the 3x3 luminances from `row` on,
// which are 0 outside the image.
float firefly_limit(float luminances[kStrip + 2][3], uint row) {
  float first = 0.0, second = 0.0;
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    if (i == 4) continue;
    float near = luminances[row + i / 3][i % 3];
    second = max(second, min(first, near));
    first = max(first, near);
  }
  float most = RAYMELD_FIREFLY * second + RAYMELD_FIREFLY_FLOOR;
  return min(1.0, most / max(luminances[row + 1][1], RAYMELD_FIREFLY_FLOOR));
}
