#include "networks/builder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace raymeld {

Tensor Builder::tensor(const std::string& name, uint32_t height, uint32_t width, uint32_t channels) {
  const auto known = exponents.find(name);
  return graph.tensor(name, {height, width, channels}, known == exponents.end() ? 0 : known->second);
}

Conv2dLink Builder::link(const std::string& name, const Tensor& in, const Tensor& out, Conv2dOptions options,
                         const std::string& bias) {
  const uint32_t u = options.unshuffle, s = options.shuffle;
  const uint32_t channels_in =
      in.shape.channels + (options.second_input ? options.second_input->shape.channels : 0);
  Conv2dShape shape{in.shape.height / u, in.shape.width / u, channels_in * u * u, out.shape.channels * s * s,
                    options.kernel};
  shape.unshuffle = u, shape.shuffle = s;
  const bool by_pixel = history_channels > 0 && name == "hrls";
  ConvWeights weights = by_pixel
                            ? model.conv_by_pixel()
                            : model.conv(name, shape.channels_out, shape.channels_in, shape.kernel, bias);
  if (a.knows_spp && !by_pixel && (name == "lrhs" || name == "hrls")) {
    const auto [lrhs_spp, hrls_spp] = samples.known(a.scale);
    weights.bias_by_spp = model.bias_by_spp(name, shape.channels_out);
    weights.log_spp = std::log2(name == "lrhs" ? lrhs_spp : hrls_spp);
  }
  options.how = choose(shape);
  if (options.how.winograd_tile() == 4 &&
      !tile_4_is_accurate(a, weights, shape.channels_in, options.kernel, options.how.algorithm)) {
    shape.most_tile = 2;
    options.how = choose(shape);
  }
  const Conv2dLink result{name, in, out, weights, options};
  if (estimate) estimate->add(graph, result);
  return result;
}

void Builder::conv(const std::string& name, const Tensor& in, const Tensor& out, const Conv2dOptions& options,
                   const std::string& bias) {
  conv2d_chain(graph, std::array{link(name, in, out, options, bias)});
}

Tensor Builder::shuffled(std::vector<Conv2dLink>& links, const std::string& name, const Tensor& x,
                         uint32_t factor, uint32_t features, Conv2dOptions options) {
  const Tensor next = tensor(name, factor * x.shape.height, factor * x.shape.width, features);
  options.shuffle = factor;
  links.push_back(link(name, x, next, options));
  return next;
}

void Builder::encode_lrhs(const Tensor& lrhs, const std::optional<FrameSize>& frame) {
  const std::array<EncodedChannel, 3> channels{{{.channel = 0}, {.channel = 1}, {.channel = 2}}};
  encode(graph, "encode.lrhs", kLrhsSlot, lrhs, channels, a.transfer, a.clip, frame);
}

void Builder::encode_hrls(const std::string& name, const Tensor& hrls, uint32_t first, uint32_t last,
                          const std::optional<FrameSize>& frame) {
  const std::span<const EncodedChannel> channels = hrls_channels.encoded;
  const auto encode_run = [&](FrameSlot slot, uint32_t begin, std::span<const EncodedChannel> run) {
    encode(graph, name, slot, hrls.slice(begin, uint32_t(run.size())), run, a.transfer, a.clip, frame);
  };
  const uint32_t computed = hrls_channels.variance.value_or(UINT32_MAX);
  if (first <= computed && computed < last) {
    if (first < computed) encode_hrls(name, hrls, first, computed, frame);
    variance(graph, "variance", hrls.slice(computed, 3), a.transfer, a.clip, frame);
    if (computed + 3 < last) encode_hrls(name, hrls, computed + 3, last, frame);
    return;
  }
  if (!graph.frame_images().inputs) {
    for (uint32_t begin = first, end = first; begin < last; begin = end) {
      const auto constants = [&] {
        return std::ranges::count_if(channels.subspan(begin, end + 3 - begin),
                                     [](const EncodedChannel& channel) { return channel.value.has_value(); });
      };
      while (end < last && constants() <= kMostConstants) end += 3;
      encode_run(kHrlsSlot, begin, channels.subspan(begin, end - begin));
    }
    return;
  }
  for (uint32_t begin = first; begin < last; begin += 3) {
    std::array<EncodedChannel, 3> run;
    std::ranges::copy(channels.subspan(begin, 3), run.begin());
    const uint32_t image = run[0].channel / 3;
    for (EncodedChannel& channel : run) channel.channel %= 3;
    encode_run(layer_slot(image), begin, run);
  }
}

Tensor Builder::layer(const Tensor& hrls, const std::string& name) const {
  return hrls.slice(hrls_channels.first.at(name), 3);
}

}  // namespace raymeld
