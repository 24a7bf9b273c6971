// Computes the models' variance layer: the variance of each color channel of HRLS over 3x3 pixels, edges
// replicated. An invocation goes down a strip of pixels, so that it reads each row once for the three rows
// that the row is a neighbour of.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

struct Row {
  vec3 left, middle, right;
};

Row row_at(ivec2 pixel, ivec2 size) {
  vec3 near[3];
  for (int i = 0; i < 3; ++i) {
    const ivec2 from = clamp(pixel + ivec2(i - 1, 0), ivec2(0), size - 1);
    for (uint c = 0; c < 3; ++c) near[i][c] = hrls[at(kColor + c, from, size)];
  }
  return Row(near[0], near[1], near[2]);
}

vec3 sum(Row row) { return row.left + row.middle + row.right; }

vec3 squares(Row row, vec3 mean) {
  row = Row(row.left - mean, row.middle - mean, row.right - mean);
  return row.left * row.left + row.middle * row.middle + row.right * row.right;
}

void main() {
  const ivec2 size = full_size();
  ivec2 pixel = strip_start();
  Row above = row_at(pixel - ivec2(0, 1), size), own = row_at(pixel, size);
  for (uint i = 0; i < kStrip; ++i) {
    const Row below = row_at(pixel + ivec2(0, 1), size);
    const vec3 mean = (sum(above) + sum(own) + sum(below)) / 9;
    const vec3 variance = (squares(above, mean) + squares(own, mean) + squares(below, mean)) / 9;
    if (inside(pixel, size)) {
      for (uint c = 0; c < 3; ++c) hrls[at(kVariance + c, pixel, size)] = variance[c];
    }
    above = own;
    own = below;
    ++pixel.y;
  }
}
