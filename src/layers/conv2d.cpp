#include <Imath/half.h>

#include <cmath>
#include <cstring>

#include "layers/layers.h"
#include "layers/shaders.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kLocalX = 32, kLocalY = 2;  // conv2d.comp's workgroup
constexpr uint32_t kRows = 4;
constexpr uint32_t kMostResiduals = 3;

// The layout of conv2d.comp: [block][in][kx][ky][lane], the last block padded with zeros.
template <typename Element>
void pack_weights(std::byte* target, std::span<const float> weight, uint32_t channels_out,
                  uint32_t channels_in, uint32_t kernel, uint32_t lanes) {
  auto* next = reinterpret_cast<Element*>(target);
  for (uint32_t block = 0; block < divide_up(channels_out, lanes); ++block) {
    for (uint32_t i = 0; i < channels_in; ++i) {
      for (uint32_t kx = 0; kx < kernel; ++kx) {
        for (uint32_t ky = 0; ky < kernel; ++ky) {
          for (uint32_t lane = 0; lane < lanes; ++lane) {
            const uint32_t o = block * lanes + lane;
            const uint64_t from = ((uint64_t{o} * channels_in + i) * kernel + ky) * kernel + kx;
            *next++ = Element(o < channels_out ? weight[from] : 0.0f);
          }
        }
      }
    }
  }
}

void check_range(const std::string& name, std::span<const float> weight) {
  for (const float value : weight) {
    if (std::abs(value) > 65504.0f) {
      throw Error("layer {}: weight {} does not fit 16 bits; use --precision fp32", name, value);
    }
  }
}

void check_shapes(const std::string& name, const Tensor& in, const Tensor& out, const ConvWeights& weights,
                  const Conv2dOptions& options) {
  const uint64_t taps = uint64_t{options.kernel} * options.kernel;
  if (options.kernel != 1 && options.kernel != 3)
    throw Error("layer {}: kernel {}, expected 1 or 3", name, options.kernel);
  if (in.shape.height != out.shape.height || in.shape.width != out.shape.width) {
    throw Error("layer {}: {}x{} in, {}x{} out, expected the same size", name, in.shape.height,
                in.shape.width, out.shape.height, out.shape.width);
  }
  if (weights.weight.size() != taps * in.shape.channels * out.shape.channels) {
    throw Error("layer {}: {} weights, expected {}x{}x{}x{}", name, weights.weight.size(), out.shape.channels,
                in.shape.channels, options.kernel, options.kernel);
  }
  if (weights.bias.size() != out.shape.channels) {
    throw Error("layer {}: {} biases, expected {}", name, weights.bias.size(), out.shape.channels);
  }
  if (options.residuals.size() > kMostResiduals)
    throw Error("layer {}: more than {} residuals", name, kMostResiduals);
  for (const Tensor& residual : options.residuals) {
    if (residual.shape != out.shape) throw Error("layer {}: a residual's shape is not the output's", name);
  }
}

}  // namespace

void conv2d(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
            const ConvWeights& weights, const Conv2dOptions& options) {
  check_shapes(name, in, out, weights, options);
  const auto [height, width, channels_out] = out.shape;
  const uint32_t channels_in = in.shape.channels, kernel = options.kernel;
  const uint32_t vectors = channels_out > 4 ? 2 : 1;
  const uint32_t lanes = 4 * vectors, blocks = divide_up(channels_out, lanes);
  const uint64_t weight_count = uint64_t{blocks} * lanes * channels_in * kernel * kernel;
  const bool half = graph.storage() == Storage::kFloat16;

  const uint32_t weight_constant =
      graph.constant(name + ".weight", weight_count * element_bytes(graph.storage()),
                     [=, weight = weights.weight](std::byte* target) {
                       if (half) {
                         check_range(name, weight);
                         pack_weights<Imath::half>(target, weight, channels_out, channels_in, kernel, lanes);
                       } else {
                         pack_weights<float>(target, weight, channels_out, channels_in, kernel, lanes);
                       }
                     });
  const uint32_t bias_constant = graph.constant(name + ".bias", uint64_t{blocks} * lanes * 4,
                                                [=, bias = weights.bias](std::byte* target) {
                                                  std::memset(target, 0, uint64_t{blocks} * lanes * 4);
                                                  std::memcpy(target, bias.data(), bias.size_bytes());
                                                });

  Pass pass;
  pass.name = name;
  pass.shader = &shaders::kConv2d;
  pass.constants = {kernel, vectors, kRows, options.relu, static_cast<uint32_t>(options.residuals.size())};
  pass.bindings = {constant_binding(weight_constant), constant_binding(bias_constant), read_binding(in),
                   write_binding(out)};
  for (uint32_t i = 0; i < kMostResiduals; ++i) {
    pass.bindings.push_back(read_binding(i < options.residuals.size() ? options.residuals[i] : in));
  }
  pass.set_push(params::Conv2d{height, width,
                               static_cast<uint32_t>(plane_stride(out.shape.pixels(), graph.storage())),
                               channels_in, channels_out});
  pass.groups = {divide_up(width, kLocalX), divide_up(height, kLocalY * kRows), blocks};
  const double pixels = static_cast<double>(out.shape.pixels());
  pass.flop = 2.0 * pixels * channels_out * channels_in * kernel * kernel;
  pass.bytes = element_bytes(graph.storage()) *
               (pixels * (channels_in + channels_out * (1.0 + options.residuals.size())) + weight_count);
  graph.add(std::move(pass));
}

}  // namespace raymeld
