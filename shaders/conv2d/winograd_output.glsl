// Declares the inputs and outputs of winograd_output.comp, finishes and stores tiles.
// llvmpipe/winograd_output_vectors.comp includes it too. It must be included after winograd.glsl.
#include "winograd_transforms.glsl"
layout(constant_id = 1) const uint kShuffle = 1;
layout(constant_id = 2) const uint kRelu = 0;
layout(constant_id = 3) const uint kResiduals = 0;
layout(constant_id = 4) const uint kPairs = 0;  // target and residuals are accessed in pairs; even width
layout(push_constant) uniform Push {
  ADDRESS(Pairs, products)
  ADDRESS(Floats, bias)
  ADDRESS(Values, target)
  ADDRESS(Values, residual0) ADDRESS(Values, residual1) ADDRESS(Values, residual2)
  WinogradOutput p;
  VECTOR_PUSH
};
BUFFER(1, readonly, Products, float, products)
BUFFER(2, readonly, Bias, float, bias)
BUFFER(3, writeonly, Target, STORAGE, target)
// The products are bound in place of residuals that are missing.
BUFFER(4, readonly, Residual0, STORAGE, residual0)
BUFFER(5, readonly, Residual1, STORAGE, residual1)
BUFFER(6, readonly, Residual2, STORAGE, residual2)

float activated(float value) { return kRelu != 0 ? rectified(value) : value; }

// Returns the address of output channel o of a pixel in the target or in a residual.
uint shuffled_address(uint o, uint y, uint x, uint rows_mask, uint plane) {
  uvec3 at = shuffled(kShuffle, o, y, x);
  return address(at.x, at.y & rows_mask, at.z, plane, kShuffle * p.width);
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

// Stores two values that are neighbours in the target, the first at an even address. Storage must
// have 32 bits.
void store_pair(uint o, uint y, uint x, vec2 values) {
  if (y >= p.height || x >= p.width) return;
  values = vec2(activated(values.x), activated(values.y));
  uint from = shuffled_address(o, y, x, p.residual_rows_mask, p.residual_plane);
  if (kResiduals > 0) values += READ_VALUES(residual0, from);
  if (kResiduals > 1) values += READ_VALUES(residual1, from);
  if (kResiduals > 2) values += READ_VALUES(residual2, from);
  uint to = shuffled_address(o, y, x, p.rows_mask, p.plane);
  WRITE_VALUES(target, to, values);
}

// Transforms the rows of both tiles, whose columns are transformed already, and adds the bias.
void finish(uint o, inout vec2 result[kMostSide][kMostSide]) {
  [[unroll]] for (uint y = 0; y < kTile; ++y) {
    transform_sums(result[y]);
    [[unroll]] for (uint x = 0; x < kTile; ++x) result[y][x] += bias.v[o];
  }
}

void store_tiles(uint o, uvec2 corners[2], vec2 result[kMostSide][kMostSide]) {
  [[unroll]] for (uint y = 0; y < kTile; ++y) {
    [[unroll]] for (uint side = 0; side < 2; ++side) {
      uint y0 = corners[side].y + y, x0 = corners[side].x;
      [[unroll]] for (uint x = 0; x < kTile; ++x) {
        if (kPairs == 0) {
          store(o, y0, x0 + x, result[y][x][side]);
        } else if (x % 2 == 0) {
          store_pair(o, y0, x0 + x, vec2(result[y][x][side], result[y][x + 1][side]));
        }
      }
    }
  }
}
