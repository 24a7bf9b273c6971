const vec3 kLuminance = vec3(0.2126, 0.7152, 0.0722);

// Returns the factor, at most 1, that darkens a firefly to RAYMELD_FIREFLY times its second brightest
// neighbour + RAYMELD_FIREFLY_FLOOR. `near` has the luminances of 3x3 pixels, which are 0 outside the image;
// the pixel's own is in the middle.
float firefly_limit(float near[9]) {
  float first = 0.0, second = 0.0;
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    if (i == 4) continue;
    second = max(second, min(first, near[i]));
    first = max(first, near[i]);
  }
  float most = RAYMELD_FIREFLY * second + RAYMELD_FIREFLY_FLOOR;
  return min(1.0, most / max(near[4], RAYMELD_FIREFLY_FLOOR));
}
