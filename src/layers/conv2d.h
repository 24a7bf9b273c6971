// Declares the parts that the kernels of conv2d() share.
#pragma once

#include <array>

#include "layers/layers.h"
#include "layers/shaders.h"

namespace raymeld {

// Describes a convolution between the shuffles:
// (height, width, channels_in) -> (height, width, channels_out).
struct Convolution {
  std::string name;
  Tensor in, out;
  Conv2dOptions options;
  uint32_t height, width, channels_in, channels_out;
  ConvWeights weights;
  bool half;  // weights are rounded to 16 bits
  // These powers of two scale the weights of `in`, the weights of the second input and the bias, as the
  // exponents of the tensors ask.
  float in_factor = 1, second_factor = 1, bias_factor = 1;

  double flop() const {
    return 2.0 * height * width * channels_out * channels_in * options.kernel * options.kernel;
  }
  // Returns the tensors that are convolved, in the order of their channels.
  std::vector<Tensor> inputs() const;
  // Returns a weight as the device keeps it, scaled for the exponents of input and output. Throws
  // Error where it does not fit.
  float weight_at(uint32_t o, uint32_t i, uint32_t ky, uint32_t kx) const;
};

// Adds the biases as a constant, with zeros after them up to `padded_count`. Returns its index.
uint32_t bias_constant(Graph& graph, const Convolution& conv, uint32_t padded_count);

// Returns the bytes of inputs, output and residuals, each counted once.
double tensor_bytes(const Graph& graph, const Convolution& conv);

// Returns a binding of residual i, or of `other` where there is none.
Binding residual_binding(const Convolution& conv, uint32_t i, const Tensor& other);

// Returns the number of parts in which input channels are summed up, each of at most `most` channels: the
// fewest, or up to half as many more where these are of one size. Part i is channels
// [i * channels / parts, (i + 1) * channels / parts).
uint32_t parts_of(uint32_t channels, uint32_t most);

// Returns the number of blocks in which output channels are computed. A block has at most
// Conv2dKernel::outputs channels, unless that made more blocks than uniform.glsl can number.
uint32_t blocks_of(const Convolution& conv);

// Returns G of Winograd's F(tile, 3), for each position the factors of a filter's three taps (Lavin and Gray
// 2016, section 4).
std::vector<std::array<double, 3>> winograd_filter(uint32_t tile);

// Adds convolutions in three steps, band by band: shaders/conv2d/winograd_*.comp. Each but the first reads
// the output of the one before, and only the rows that this takes are kept.
void conv2d_winograd(Graph& graph, std::span<const Convolution> convs);

// Adds a convolution by cooperative matrices: shaders/conv2d/conv2d_matrix.comp.
void conv2d_matrix(Graph& graph, const Convolution& conv);

// Adds a 1x1 convolution: shaders/conv2d/pointwise.comp.
void conv2d_pointwise(Graph& graph, const Convolution& conv);

// Adds a 1x1 convolution of unshuffled pixels: shaders/conv2d/pointwise_unshuffled.comp.
void conv2d_pointwise_unshuffled(Graph& graph, const Convolution& conv);

inline constexpr uint32_t kMostResiduals = 3;

}  // namespace raymeld
