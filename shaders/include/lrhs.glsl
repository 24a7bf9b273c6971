// Reads a sample of `lrhs`, whose size is in UPSAMPLED, and the bilinear sum of four samples.
float lrhs_at(uint c, uint y, uint x) {
  return float(lrhs.v[address(c, y, x, UPSAMPLED.lrhs_plane, UPSAMPLED.lrhs_width)]);
}

float upsampled(uint c, Bilinear at) {
  return blended(at, vec4(lrhs_at(c, at.low.y, at.low.x), lrhs_at(c, at.low.y, at.high.x),
                          lrhs_at(c, at.high.y, at.low.x), lrhs_at(c, at.high.y, at.high.x)));
}
