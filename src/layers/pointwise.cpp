// 1x1 convolutions: one band of pixels after another, so that the sums of a band stay in a cache.
#include <algorithm>
#include <numeric>

#include "layers/conv2d.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kLocal = 64;  // pixels of a workgroup of pointwise.comp

// The layout of pointwise.comp: [block][in][output], zeros where channels end early.
void pack_weights(std::byte* target, const Convolution& conv, uint32_t outputs, uint32_t blocks) {
  auto* next = reinterpret_cast<float*>(target);
  for (uint32_t block = 0; block < blocks; ++block) {
    for (uint32_t i = 0; i < conv.channels_in; ++i) {
      for (uint32_t o = block * outputs; o < (block + 1) * outputs; ++o)
        *next++ = o < conv.channels_out ? conv.weight_at(o, i, 0, 0) : 0.0f;
    }
  }
}

}  // namespace

void conv2d_pointwise(Graph& graph, const Convolution& conv) {
  const Conv2dKernel& how = conv.options.how;
  if (conv.options.unshuffle > 1 || conv.options.shuffle > 1)
    throw Error("layer {}: a shuffled 1x1", conv.name);
  const auto pixels = static_cast<uint32_t>(conv.out.shape.pixels());
  const uint32_t band = std::clamp(how.band / kLocal, 1u, divide_up(pixels, kLocal)) * kLocal;
  const uint32_t blocks = blocks_of(conv), outputs = divide_up(conv.channels_out, blocks);
  const uint32_t parts = parts_of(conv.channels_in, how.channels);
  const uint64_t weight_count = uint64_t{blocks} * outputs * conv.channels_in;
  const uint32_t weights =
      graph.constant(conv.name + ".weight", weight_count * sizeof(float),
                     [=](std::byte* target) { pack_weights(target, conv, outputs, blocks); });
  const uint32_t bias = bias_constant(graph, conv, blocks * outputs);
  const Tensor sums = graph.scratch(conv.name + ".sums", uint64_t{band} * blocks * outputs);
  const auto residuals = static_cast<uint32_t>(conv.options.residuals.size());
  for (uint32_t first = 0; first < pixels; first += band) {
    const double share = double(std::min(band, pixels - first)) / pixels / parts;
    for (uint32_t part = 0; part < parts; ++part) {
      const uint32_t channel = part * conv.channels_in / parts, end = (part + 1) * conv.channels_in / parts;
      const bool last = part + 1 == parts;
      Pass pass;
      pass.name = conv.name;
      pass.shader = &shaders::kPointwise[graph.addressed()];
      pass.constants = {end - channel, outputs, how.order, part == 0, last, conv.options.relu, residuals};
      pass.bindings = {constant_binding(weights), constant_binding(bias), read_binding(conv.in),
                       write_binding(sums), write_binding(conv.out)};
      for (uint32_t i = 0; i < kMostResiduals; ++i)
        pass.bindings.push_back(residual_binding(conv, i, conv.in));
      for (Binding& binding : pass.bindings)
        binding.by_address = graph.addressed() || binding.kind == Binding::Kind::kConstant;
      params::Pointwise push{plane_of(graph, conv.out), pixels, first, conv.channels_in, channel,
                             conv.channels_out,         blocks, {}};
      std::iota(std::begin(push.digits), std::end(push.digits), 0u);
      pass.set_push(push);
      pass.groups = {std::min(band, divide_up(pixels - first, kLocal) * kLocal) / kLocal, blocks, 1};
      pass.flop = share * conv.flop();
      pass.bytes =
          share * (traffic(graph, conv.in) + traffic(graph, conv.out) * (last ? 1.0 + residuals : 0.0) +
                   double(weight_count) * sizeof(float));
      graph.add(std::move(pass));
    }
  }
}

}  // namespace raymeld
