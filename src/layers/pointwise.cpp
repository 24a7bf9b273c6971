// Adds 1x1 convolutions, one band of pixels after another, so that the sums of a band stay in a cache.
#include <algorithm>

#include "layers/conv2d.h"
#include "layers/llvmpipe.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kLocalPixels = 64;  // pixels of a workgroup of pointwise.comp

// Writes weights in the layout of pointwise.comp, [block][in][output], zeros where channels end early.
void pack_weights(std::byte* target, const Convolution& conv, uint32_t outputs, uint32_t blocks) {
  auto* next = reinterpret_cast<float*>(target);
  for (uint32_t block = 0; block < blocks; ++block) {
    for (uint32_t i = 0; i < conv.channels_in; ++i) {
      for (uint32_t o = block * outputs; o < (block + 1) * outputs; ++o)
        *next++ = o < conv.channels_out ? conv.weight_at(o, i, 0, 0) : 0.0f;
    }
  }
}

// Holds input channels that one dispatch sums up; `channel` is the first one, counted over all inputs.
struct Part {
  Tensor source;
  uint32_t channel;
};

std::vector<Part> parts_by_input(const Convolution& conv) {
  std::vector<Part> all;
  uint32_t before = 0;
  for (const Tensor& in : conv.inputs()) {
    const uint32_t channels = in.shape.channels;
    const uint32_t parts = parts_of(channels, conv.options.how.channels);
    for (uint32_t i = 0; i < parts; ++i) {
      const uint32_t first = i * channels / parts, end = (i + 1) * channels / parts;
      all.push_back({in.slice(first, end - first), before + first});
    }
    before += channels;
  }
  return all;
}

}  // namespace

void conv2d_pointwise(Graph& graph, const Convolution& conv) {
  const Conv2dKernel& how = conv.options.how;
  const uint32_t pixels = conv.height * conv.width;
  const uint32_t band =
      std::clamp(how.band / kLocalPixels, 1u, divide_up(pixels, kLocalPixels)) * kLocalPixels;
  const uint32_t blocks = blocks_of(conv), outputs = divide_up(conv.channels_out, blocks);
  const std::vector<Part> parts = parts_by_input(conv);
  const uint64_t weight_count = uint64_t{blocks} * outputs * conv.channels_in;
  const uint32_t weights =
      graph.constant(conv.name + ".weight", weight_count * sizeof(float),
                     [=](std::byte* target) { pack_weights(target, conv, outputs, blocks); });
  const uint32_t bias = bias_constant(graph, conv, blocks * outputs);
  const Tensor sums = graph.scratch(conv.name + ".sums", uint64_t{band} * blocks * outputs);
  const uint32_t vector = llvmpipe::product_vector(how, band);
  const auto residuals = static_cast<uint32_t>(conv.options.residuals.size());
  for (uint32_t first = 0; first < pixels; first += band) {
    for (const auto& [source, channel] : parts) {
      const uint32_t channels = source.shape.channels;
      const bool last = channel + channels == conv.channels_in;
      const double pixel_share = double(std::min(band, pixels - first)) / pixels;
      const double share = pixel_share * channels / conv.channels_in;
      std::vector<Binding> bindings{constant_binding(weights, true), constant_binding(bias, true),
                                    read_binding(source), write_binding(sums), write_binding(conv.out)};
      for (uint32_t i = 0; i < kMostResiduals; ++i) bindings.push_back(residual_binding(conv, i, conv.in));
      Pass pass = pass_of(graph, conv.name, shaders::kPointwise, std::move(bindings), vector > 0);
      pass.constants = {
          channels, outputs, channel == 0, last, last && conv.options.relu, last ? residuals : 0};
      pass.constants.insert(pass.constants.end(), {how.order, vector, conv.options.shuffle});
      set_push(pass,
               params::Pointwise{graph.plane(source), graph.plane(conv.out), conv.channels_in, channel,
                                 conv.channels_out, blocks, first, pixels, conv.width},
               vector > 0);
      pass.groups = {std::min(band, divide_up(pixels - first, kLocalPixels) * kLocalPixels) / kLocalPixels,
                     blocks, 1};
      pass.flop = share * conv.flop();
      pass.bytes = pixel_share * traffic(graph, source) + share * double(weight_count) * sizeof(float) +
                   (last ? pixel_share * traffic(graph, conv.out) * (1.0 + residuals) : 0.0);
      graph.add(std::move(pass));
    }
  }
}

}  // namespace raymeld
