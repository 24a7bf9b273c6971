// The encoded colors of HRLS and of LRHS upsampled, which settle a pixel where they agree.
float color_at(uint c, uvec2 at) { return float(color.v[address(c, at.y, at.x, p.plane, p.width)]); }

float lrhs_at(uint c, uint y, uint x) { return float(lrhs.v[address(c, y, x, p.lrhs_plane, p.lrhs_width)]); }

float upsampled(uint c, Bilinear at) {
  return blended(at, vec4(lrhs_at(c, at.low.y, at.low.x), lrhs_at(c, at.low.y, at.high.x),
                          lrhs_at(c, at.high.y, at.low.x), lrhs_at(c, at.high.y, at.high.x)));
}
