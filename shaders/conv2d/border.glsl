// A table of biases has one for each set of borders that a pixel may touch: input channels that are one value everywhere are
// in the bias, but for the taps that fall on the zeros outside the image. To be included behind params.h.
uint border_case(uint y, uint x, uint height, uint width) {
  return (y == 0 ? RAYMELD_TOP : 0) | (y + 1 == height ? RAYMELD_BOTTOM : 0) | (x == 0 ? RAYMELD_LEFT : 0) |
         (x + 1 == width ? RAYMELD_RIGHT : 0);
}
