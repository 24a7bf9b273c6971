// Computes the same as winograd_input.comp with F(4, 3) on drivers that make vectors of eight invocations:
// see vector.glsl. The 64 pixels of a vector's eight pairs of tiles are read as vectors of neighbours, which
// are transposed between the vertical transform and the horizontal one. Rows of tiles must be whole numbers
// of vectors. 64 `zeros` are read outside the image: if a condition chose values after the load, compilers
// would make a load for each lane.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "params.h"
#include "tensor.glsl"
#define WEIGHTS_BY_ADDRESS
#define VECTOR_PUSH uint digits[4];
#include "memory.glsl"
#include "winograd.glsl"
#include "winograd_transforms.glsl"

layout(local_size_x = 32) in;
#include "invocation.glsl"
const uint kVector = 8;
const uint kColumns = 8;  // columns of a pair of tiles, without the border column on either side
layout(push_constant) uniform Push {
  Floats source;
  Floats zeros;
  Floats transformed;
  WinogradInput p;
  VECTOR_PUSH
};
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"

// Returns the floats at `address`, or zeros. A conditional of pointers would be a branch.
Floats where(bool inside, uint64_t address) {
  return Floats(uint64_t(zeros) ^ ((address ^ uint64_t(zeros)) & (0ul - uint64_t(inside))));
}

// Swaps lane i of v[k] with lane k of v[i]. If the lanes to swap were constants, compilers would load each
// value by itself, right where it belongs.
void transpose(inout float v[kVector]) {
  [[unroll]] for (uint side = kVector / 2; side > 0; side /= 2) {
    bool upper = (gl_SubgroupInvocationID & side) != 0;
    uint other = gl_SubgroupInvocationID ^ uniform_number(side);
    [[unroll]] for (uint i = 0; i < kVector; ++i) {
      if ((i & side) != 0) continue;
      float moved = subgroupShuffle(upper ? v[i] : v[i + side], other);
      v[i] = upper ? moved : v[i];
      v[i + side] = upper ? v[i + side] : moved;
    }
  }
}

void main() {
  uint first = first_of_vector().x, channel = uniform_number(gl_WorkGroupID.z);
  uint pairs = p.tiles_x / 2, row = quotient(first, pairs), left = kColumns * (first - row * pairs);
  uint y0 = (p.first_tile_row + row) * kTile + p.first_y;  // wraps around above the image
  Floats rows[kMostSide], before[kMostSide], after[kMostSide];
  [[unroll]] for (uint y = 0; y < kSide; ++y) {
    bool inside = y0 + y < p.height;
    uint64_t at = uint64_t(source) + 4ul * address(channel, (y0 + y) & p.rows_mask, left, p.plane, p.width);
    rows[y] = where(inside, at);
    before[y] = where(inside && left > 0, at - 4ul);
    after[y] = where(inside && left + kVector * kColumns < p.width, at + 4ul * kVector * kColumns);
  }
  float columns[kMostSide][kColumns];  // [row][x] is column kVector * x + lane
  vec2 sides[kMostSide];               // the columns before and after all of them
  [[unroll]] for (uint x = 0; x <= kColumns; x += 2) {
    vec2 d[kMostSide];
    [[unroll]] for (uint y = 0; y < kSide; ++y) {
      if (x < kColumns) {
        d[y] = vec2(read_vector(rows[y], x * kVector), read_vector(rows[y], (x + 1) * kVector));
      } else {
        d[y] = vec2(before[y].v[0], after[y].v[0]);
      }
    }
    transform_input(d);
    float all = 0.0;
    [[unroll]] for (uint y = 0; y < kSide; ++y) {
      all += d[y].x + d[y].y;
      if (x < kColumns) {
        columns[y][x] = d[y].x;
        columns[y][x + 1] = d[y].y;
      } else {
        sides[y] = d[y];
      }
    }
    keep_order(all);
  }
  if (end_order()) return;
  uint lane = gl_SubgroupInvocationID;
  uint one_left = (lane + uniform_number(kVector - 1)) % kVector,
       one_right = (lane + uniform_number(1)) % kVector;
  uint to = element(0, p.first_channel + channel, 2 * first, p.position_stride, p.channels);
  [[unroll]] for (uint y = 0; y < kSide; ++y) {
    transpose(columns[y]);  // now each lane has its own pair of tiles
    float own[kColumns + 2];
    [[unroll]] for (uint x = 0; x < kColumns; ++x) own[x + 1] = columns[y][x];
    float left_one = subgroupShuffle(own[kColumns], one_left), right_one = subgroupShuffle(own[1], one_right);
    own[0] = lane == 0 ? sides[y].x : left_one;
    own[kColumns + 1] = lane == kVector - 1 ? sides[y].y : right_one;
    vec2 d[kMostSide];
    [[unroll]] for (uint x = 0; x < kSide; ++x) d[x] = vec2(own[x], own[x + kColumns / 2]);
    transform_input(d);
    [[unroll]] for (uint x = 0; x < kSide; ++x)
      Pairs(uint64_t(transformed) + 4ul * (to + (y * kSide + x) * p.position_stride)).v[lane] = pair(d[x]);
  }
}
