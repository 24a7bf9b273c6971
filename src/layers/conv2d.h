// What the kinds of conv2d() share.
#pragma once

#include "layers/layers.h"
#include "layers/shaders.h"

namespace raymeld {

// A convolution of what unshuffle() made of the input, before shuffle(): (height, width, channels_in) ->
// (height, width, channels_out).
struct Convolution {
  std::string name;
  Tensor in, out;
  Conv2dOptions options;
  uint32_t height, width, channels_in, channels_out;
  std::span<const float> weight, bias;
  // Of the weights' input channels: those that are convolved, in order, and what others are but 0.
  std::vector<uint32_t> sources;
  std::vector<std::pair<uint32_t, float>> constants;
  bool half;  // weights are rounded to 16 bits
  // For the exponents of the tensors: of the weights of `in`, of those of what is behind it, of the bias.
  // Powers of two.
  float in_factor = 1, second_factor = 1, bias_factor = 1;

  double flop() const {
    return 2.0 * height * width * channels_out * channels_in * options.kernel * options.kernel;
  }
  // What is convolved, in the order of its channels.
  std::vector<Tensor> inputs() const;
  // As the device keeps it, for what is stored of its input and output. Throws Error where it does not fit.
  float weight_at(uint32_t o, uint32_t i, uint32_t ky, uint32_t kx) const;
  // The bias and what the constants add to it, but for taps beyond the borders that `border_case` names (see
  // shaders/border.glsl); as the device keeps it.
  float bias_at(uint32_t o, uint32_t border_case) const;
  // Whether that depends on borders.
  bool has_borders() const { return options.kernel > 1 && !constants.empty(); }

 private:
  // A weight [o][channel][ky][kx] of the model's, times a power of two.
  float stored_weight(uint32_t o, uint32_t channel, uint32_t ky, uint32_t kx, float factor) const;
};

// With zeros behind the last one, so that they are `padded_count`; has_borders(): as many for each case.
uint32_t bias_constant(Graph& graph, const Convolution& conv, uint32_t padded_count);

// Inputs, output and residuals, each once.
double tensor_bytes(const Graph& graph, const Convolution& conv);

// `residuals[i]`, or `other` where there is none.
Binding residual_binding(const Convolution& conv, uint32_t i, const Tensor& other);

// Input channels are summed up in parts of at most `most`: the fewest parts, or some more where these are of
// one size. Part i is channels [i * channels / parts, (i + 1) * channels / parts).
uint32_t parts_of(uint32_t channels, uint32_t most);

// Output channels are computed in as many blocks: of at most Conv2dKernel::outputs, unless these were more
// than uniform.glsl numbers.
uint32_t blocks_of(const Convolution& conv);

// Conv2dKernel::vector, or 0 where the shaders have no place for such vectors of `items` tiles or pixels.
uint32_t usable_vector(const Conv2dKernel& how, uint32_t items);

// In three steps, band by band: shaders/winograd_*.comp. Each convolution but the first reads what the one
// before wrote; in between, only as many rows as that takes are kept.
void conv2d_winograd(Graph& graph, std::span<const Convolution> convs);

// By cooperative matrices: shaders/conv2d_matrix.comp.
void conv2d_matrix(Graph& graph, const Convolution& conv);

// Of a 1x1: shaders/pointwise.comp.
void conv2d_pointwise(Graph& graph, const Convolution& conv);

// Of a 1x1 of what is unshuffled: shaders/pointwise_cells.comp.
void conv2d_pointwise_unshuffled(Graph& graph, const Convolution& conv);

inline constexpr uint32_t kMostResiduals = 3;

}  // namespace raymeld
