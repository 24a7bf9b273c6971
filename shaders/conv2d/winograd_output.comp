// Last of three steps of a convolution: A^T m A of every tile and output channel of a band of rows, then bias, ReLU and
// residuals as in conv2d.comp. With kShuffle r > 1, pixel_shuffle() by r of that is stored, residuals being of the
// shuffled shape. Each invocation makes two tiles, side by side but for pairs that vectors made, of kOutputs output channels;
// z counts these.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"
#include "winograd.glsl"
#include "border.glsl"

layout(local_size_x = 32) in;
#include "invocation.glsl"
layout(constant_id = 1) const uint kShuffle = 1;
layout(constant_id = 2) const uint kRelu = 0;
layout(constant_id = 3) const uint kResiduals = 0;
layout(constant_id = 4) const uint kPairs = 0;  // rows of the target and of residuals are accessed by pairs of floats
layout(constant_id = 5) const uint kBorders = 0;  // the bias is a table, see border.glsl
layout(constant_id = 6) const uint kVector = 0;   // the products lie as pairs
layout(constant_id = 7) const uint kOutputs = 1;  // 2 with pairs of what is shuffled: of neighbours after that
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Pairs products;
  Floats bias;
  Values target;
  Values residual0, residual1, residual2;
  WinogradOutput p;
};
#else
layout(push_constant) uniform Push {
  WinogradOutput p;
};
layout(std430, binding = 1) readonly buffer Products { float v[]; } products;
layout(std430, binding = 2) readonly buffer Bias { float v[]; } bias;
layout(std430, binding = 3) writeonly buffer Target { STORAGE v[]; } target;
// Bound to the products where there are fewer residuals.
layout(std430, binding = 4) readonly buffer Residual0 { STORAGE v[]; } residual0;
layout(std430, binding = 5) readonly buffer Residual1 { STORAGE v[]; } residual1;
layout(std430, binding = 6) readonly buffer Residual2 { STORAGE v[]; } residual2;
#endif
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"
#include "tile_pair.glsl"

vec2 load(uint at) {
#ifdef DATA_BY_ADDRESS
  if (kVector != 0) {
    Floats both = Floats(uint64_t(products) + 4ul * at);
    return vec2(read_vector(both, 0), read_vector(both, kVector));
  }
  return floats(products.v[at / 2]);
#else
  return vec2(products.v[at], products.v[at + 1]);
#endif
}

float bias_at(uint o, uint y, uint x, float inside) {
  return kBorders != 0 ? bias.v[border_case(y, x, p.full_height, p.width) * p.channels + o] : inside;
}

float activated(float value) { return kRelu != 0 ? rectified(value) : value; }

// Where the target or a residual has output channel o of a pixel.
uint shuffled_address(uint o, uint y, uint x, uint rows_mask, uint plane) {
  uint row = kShuffle * y + o / kShuffle % kShuffle, column = kShuffle * x + o % kShuffle;
  return address(o / (kShuffle * kShuffle), row & rows_mask, column, plane, kShuffle * p.width);
}

void store(uint o, uint y, uint x, float value) {
  if (y >= p.height || x >= p.width) return;
  value = activated(value);
  uint from = shuffled_address(o, y, x, p.residual_rows_mask, p.residual_plane);
  if (kResiduals > 0) value += float(residual0.v[from]);
  if (kResiduals > 1) value += float(residual1.v[from]);
  if (kResiduals > 2) value += float(residual2.v[from]);
  target.v[shuffled_address(o, y, x, p.rows_mask, p.plane)] = STORAGE(storable(value));
}

// The same of two that are neighbours where they are stored, the first one where x is even.
void store_pair(uint o, uint y, uint x, vec2 values) {
#if defined(DATA_BY_ADDRESS) && !defined(STORAGE_F16)
  if (y >= p.height || x >= p.width) return;
  values = vec2(activated(values.x), activated(values.y));
  uint from = shuffled_address(o, y, x, p.residual_rows_mask, p.residual_plane) / 2;
  if (kResiduals > 0) values += floats(Pairs(uint64_t(residual0)).v[from]);
  if (kResiduals > 1) values += floats(Pairs(uint64_t(residual1)).v[from]);
  if (kResiduals > 2) values += floats(Pairs(uint64_t(residual2)).v[from]);
  Pairs(uint64_t(target)).v[shuffled_address(o, y, x, p.rows_mask, p.plane) / 2] = pair(values);
#endif
}

// A^T m in place, of two columns or rows at once; the first kTile elements are the result.
void transform(inout vec2 m[kMostSide]) {
  if (kSide == 4) {
    m[0] += m[1] + m[2];
    m[1] -= m[2] + m[3];
  } else if (kSide == 6) {
    vec2 sum = m[1] + m[2], difference = m[1] - m[2], sum2 = m[3] + m[4], difference2 = m[3] - m[4];
    m[0] += sum + sum2;
    m[1] = difference + 2.0 * difference2;
    m[2] = sum + 4.0 * sum2;
    m[3] = difference + 8.0 * difference2 + m[5];
  }
}

void main() {
  uint o = kOutputs * (kVector != 0 ? uniform_number(gl_WorkGroupID.z) : global_invocation_id().z);
  uint tile = 2 * first_of_vector().x;
  uvec2 corners[2];
  if (kVector != 0) {
    uint lane = gl_SubgroupInvocationID;
    [[unroll]] for (uint i = 0; i < 2; ++i)
      corners[i] = corner(tile + tile_of_pairs(i * kVector + lane, kVector), p.first_tile_row, p.tiles_x);
  } else {
    corners[0] = pair_corner(p.first_tile_row, p.tiles_x);
    corners[1] = corners[0] + uvec2(kTile, 0);
  }
  vec2 result[2][kMostSide][kMostSide];  // [row][column], of both tiles
  [[unroll]] for (uint k = 0; k < kOutputs; ++k) {
    uint at = element(0, o + k, tile, p.position_stride, p.channels);
    [[unroll]] for (uint x = 0; x < kSide; ++x) {
      vec2 m[kMostSide];
      [[unroll]] for (uint y = 0; y < kSide; ++y) m[y] = load(at + (y * kSide + x) * p.position_stride);
      transform(m);
      [[unroll]] for (uint y = 0; y < kTile; ++y) result[k][y][x] = m[y];
      if (kVector != 0) keep_order(result[k][0][x].x + result[k][0][x].y);
    }
    float inside = bias.v[o + k];
    [[unroll]] for (uint y = 0; y < kTile; ++y) {
      transform(result[k][y]);
      [[unroll]] for (uint side = 0; side < 2; ++side) {
        [[unroll]] for (uint x = 0; x < kTile; ++x)
          result[k][y][x][side] += bias_at(o + k, corners[side].y + y, corners[side].x + x, inside);
      }
    }
  }
  if (kVector != 0 && end_order()) return;
  [[unroll]] for (uint y = 0; y < kTile; ++y) {
    [[unroll]] for (uint side = 0; side < 2; ++side) {
      uint y0 = corners[side].y + y, x0 = corners[side].x;
      [[unroll]] for (uint x = 0; x < kTile; ++x) {
        float value = result[0][y][x][side];
        if (kPairs == 0) {
          store(o, y0, x0 + x, value);
        } else if (kOutputs == 2) {
          store_pair(o, y0, x0 + x, vec2(value, result[1][y][x][side]));
        } else if (x % 2 == 0) {
          store_pair(o, y0, x0 + x, vec2(value, result[0][y][x + 1][side]));
        }
      }
    }
  }
}
