// The output of the blocks of a sparse graph that are not needed: the mean of HRLS and of LRHS upsampled, encoded; less the
// latter where decode adds it. One invocation for each pixel.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "bilinear.glsl"
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
#include "invocation.glsl"
layout(constant_id = 0) const uint kResidual = 0;  // decode adds the upsampled LRHS
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Values color, lrhs, target;
  Upsampled p;
};
#else
layout(push_constant) uniform Push { Upsampled p; };
layout(std430, binding = 1) readonly buffer Color { STORAGE v[]; } color;
layout(std430, binding = 2) readonly buffer Lrhs { STORAGE v[]; } lrhs;
layout(std430, binding = 3) writeonly buffer Target { STORAGE v[]; } target;
#endif
#include "settled.glsl"
#include "sparse.glsl"

void main() {
  uvec2 id = global_invocation_id().xy;
  if (id.x >= p.width || id.y >= p.height) return;
  uint side = RAYMELD_SPARSE_SIDE * (p.width / p.lrhs_width), columns = (p.width + side - 1) / side;
  if (sparse_word(RAYMELD_SPARSE_DISTANCES + id.y / side * columns + id.x / side) == 0) return;
  Bilinear low = bilinear_at(id, p.phase, p.inverse_scale, uvec2(p.lrhs_width, p.lrhs_height));
  for (uint c = 0; c < 3; ++c) {
    float own = color_at(c, id), base = upsampled(c, low);
    float value = 0.5 * (kResidual != 0 ? own - base : own + base);
    target.v[address(c, id.y, id.x, p.plane, p.width)] = STORAGE(storable(value));
  }
}
