// Returns the entry of a bias table that a pixel takes; the table has one for each set of borders that a
// pixel may touch. Input channels that are one value everywhere are part of the bias, except for the taps
// that fall on the zeros outside the image. It must be included after params.h.
uint border_case(uint y, uint x, uint height, uint width) {
  return (y == 0 ? RAYMELD_TOP : 0) | (y + 1 == height ? RAYMELD_BOTTOM : 0) | (x == 0 ? RAYMELD_LEFT : 0) |
         (x + 1 == width ? RAYMELD_RIGHT : 0);
}
