// Has what conv2d.comp and conv2d_columns.comp share: their parameters, where their input, weights and biases
// lie, and how they store the result. WEIGHTS is the type of a vector of weights. It must be included after
// params.h and tensor.glsl.

layout(constant_id = 1) const uint kVectors = 2;
layout(constant_id = 3) const uint kRelu = 0;
layout(constant_id = 4) const uint kResiduals = 0;
layout(constant_id = 5) const uint kSecondInput = 0;  // a second input has channels from p.channels_first on
layout(constant_id = 6) const uint kUnshuffle = 1;  // 1 where there is a second input
layout(constant_id = 7) const uint kShuffle = 1;
layout(push_constant) uniform Push {
  Conv2d p;
};
layout(std430, binding = 1) restrict readonly buffer Weights { WEIGHTS weights[]; };
layout(std430, binding = 2) restrict readonly buffer Bias { vec4 bias[]; };
layout(std430, binding = 3) restrict readonly buffer Input { STORAGE in_data[]; };
layout(std430, binding = 4) restrict writeonly buffer Output { STORAGE out_data[]; };
// The input is bound in place of residuals that are missing.
layout(std430, binding = 5) restrict readonly buffer Residual0 { STORAGE residual0[]; };
layout(std430, binding = 6) restrict readonly buffer Residual1 { STORAGE residual1[]; };
layout(std430, binding = 7) restrict readonly buffer Residual2 { STORAGE residual2[]; };
// The input is bound where there is no second input.
layout(std430, binding = 8) restrict readonly buffer Second { STORAGE second_data[]; };

// Returns where channel i of the unshuffled input starts.
uint source_of(uint i) {
  uvec3 at = shuffled(kUnshuffle, i, 0, 0);
  return address(at.x, at.y, at.z, p.plane_in, kUnshuffle * p.width);
}

// Returns where a pixel lies in a channel, and whether it is in the image: unsigned numbers wrap around above
// and left of it, to far outside.
uint pixel_at(uint y, uint x, out bool inside) {
  inside = y < p.height && x < p.width;
  return inside ? kUnshuffle * (y * kUnshuffle * p.width + x) : 0;
}

void store(uint o, uint y, uint x, float value) {
  uvec3 place = shuffled(kShuffle, o, y, x);
  uint at = address(place.x, place.y, place.z, p.plane_out, kShuffle * p.width);
  if (kRelu != 0) value = rectified(value);
  if (kResiduals > 0) value += float(residual0[at]);
  if (kResiduals > 1) value += float(residual1[at]);
  if (kResiduals > 2) value += float(residual2[at]);
  out_data[at] = STORAGE(storable(value));
}

// Stores the output channels of a pixel that a block has.
void store_block(uint block, uint y, uint x, vec4 sum[kVectors]) {
  [[unroll]] for (uint v = 0; v < kVectors; ++v) {
    [[unroll]] for (uint k = 0; k < 4; ++k) {
      uint o = (block * kVectors + v) * 4 + k;
      if (o < p.channels_out) store(o, y, x, sum[v][k]);
    }
  }
}
