// Makes the values that layers and networks are tested with. They are the same on every machine.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "reference/reference.h"

namespace raymeld::reference {

enum class Fill {
  kUniform,   // values in [-1, 1)
  kIntegers,  // -2 .. 2: sums are exact in fp32, and in fp16 while they stay below 2^11
  kSigns,     // -1, 0, 1
  kSpecials,  // every other value one of special_values()
};

// Returns +-0, subnormals, the limits of half and float, fireflies, infinities and NaN.
const std::vector<float>& special_values();

// Returns floats. The same seed gives the same values on every machine.
Planes random_planes(int c, int h, int w, Fill fill, uint64_t seed);

// kUniform weights are scaled by 1 / sqrt(in * kernel^2), which keeps activations near 1 through many layers.
Conv random_conv(int out, int in, int kernel, Fill fill, uint64_t seed);
// Rounds values as the device reads them: weights to the storage type, biases to fp32.
Conv round_to(Conv conv, Precision precision);

// Returns uniform weights for `architecture` by the model file's names, rounded as above.
Weights random_weights(const Architecture& architecture, Precision precision, uint64_t seed);

struct Size {
  int h, w;
};
// Returns 1x1, single rows and columns, primes, tile sizes and one more or less than a tile.
const std::vector<Size>& awkward_sizes();

std::vector<float> floats(const Planes& planes);
Planes planes(int c, int h, int w, std::span<const float> values);

}  // namespace raymeld::reference
