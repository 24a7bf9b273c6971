// The encoded colors of HRLS and of LRHS upsampled, which settle a pixel where they agree.
float color_at(uint c, uvec2 at) { return float(color.v[address(c, at.y, at.x, p.plane, p.width)]); }

#define UPSAMPLED p
#include "lrhs.glsl"
