// Declares the inputs and outputs of pointwise.comp and stores its sums.
// llvmpipe/pointwise_vectors.comp includes it too.
const uint kLanes = RAYMELD_LANES;  // sums of neighbouring pixels lie side by side
layout(constant_id = 0) const uint kChannels = 64;
layout(constant_id = 1) const uint kOutputs = 16;
layout(constant_id = 2) const uint kFirst = 1;
layout(constant_id = 3) const uint kLast = 1;
layout(constant_id = 4) const uint kRelu = 0;
layout(constant_id = 5) const uint kResiduals = 0;
layout(constant_id = 8) const uint kShuffle = 1;  // the result is stored after pixel_shuffle() by this
layout(push_constant) uniform Push {
  Floats weights;
  Floats bias;
  ADDRESS(Values, source)
  ADDRESS(Floats, sums)
  ADDRESS(Values, target)
  ADDRESS(Values, residual0) ADDRESS(Values, residual1) ADDRESS(Values, residual2)
  Pointwise p;
  VECTOR_PUSH
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, , Sums, float, sums)
BUFFER(3, writeonly, Target, STORAGE, target)
// The source is bound in place of residuals that are missing.
BUFFER(4, readonly, Residual0, STORAGE, residual0)
BUFFER(5, readonly, Residual1, STORAGE, residual1)
BUFFER(6, readonly, Residual2, STORAGE, residual2)

Floats block_weights(uint block) {
  return Floats(uint64_t(weights) + 4ul * ((block * p.channels_in + p.first_channel) * kOutputs));
}

Floats block_bias(uint block) { return Floats(uint64_t(bias) + 4ul * (block * kOutputs)); }

// Returns where the sum of a block's first output channel is kept.
uint sum_address(uint block, uint in_band) {
  return (in_band / kLanes * p.blocks + block) * kOutputs * kLanes + in_band % kLanes;
}

void store(uint at, float value, bool inside) {
  if (kRelu != 0) value = rectified(value);
  if (kResiduals > 0) value += float(residual0.v[at]);
  if (kResiduals > 1) value += float(residual1.v[at]);
  if (kResiduals > 2) value += float(residual2.v[at]);
  target.v[at] = STORAGE(storable(inside ? value : 0.0));
}

// Returns pixel / width. Some drivers for CPUs divide integers lane by lane, so this divides floats, whose
// quotient is off by less than 1 as an image has fewer than 2^22 rows.
uint row_of(uint pixel) {
  uint row = uint(float(pixel) / float(p.width));
  row -= uint(row * p.width > pixel);
  return row + uint(pixel - row * p.width >= p.width);
}

// Keeps the sums for the next part, or stores the output after the last one.
void store_sums(uint block, uint pixel, uint sum_at, float sum[kOutputs]) {
  if (kLast == 0) {
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) sums.v[sum_at + o * kLanes] = sum[o];
    return;
  }
  if (kShuffle == 1) {
    // Invocations beyond the last pixel write into the padding of the plane.
    uint to = block * kOutputs * p.plane_out + pixel;
    [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
      if (block * kOutputs + o < p.channels_out) store(to + o * p.plane_out, sum[o], pixel < p.pixels);
    }
    return;
  }
  if (pixel >= p.pixels) return;
  uint y = row_of(pixel), x = pixel - y * p.width, width = kShuffle * p.width;
  [[unroll]] for (uint o = 0; o < kOutputs; ++o) {
    uint channel = block * kOutputs + o;
    uvec3 to = shuffled(kShuffle, channel, y, x);
    if (channel < p.channels_out) store(address(to.x, to.y, to.z, p.plane_out, width), sum[o], true);
  }
}
