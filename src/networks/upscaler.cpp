#include "networks/upscaler.h"

namespace raymeld {

void parse_upscaler(const Entries& entries, Architecture& a) {
  a.features = entries.integer("features", 1, kMostChannels);
  a.lrhs_centered = entries.choice("lrhs_sampling", "centered", "nearest");
}

UpscalerBuilder::UpscalerBuilder(const Builder& builder, uint32_t lrhs_height, uint32_t lrhs_width,
                                 float lrhs_phase)
    : Builder(builder), height(lrhs_height), width(lrhs_width), phase(lrhs_phase) {
  lrhs = tensor("encode.lrhs", height, width, 3);
  encode_lrhs(lrhs);
  bright = tensor("above_clip", height, width, 3);
  above_clip(graph, "above_clip", kLrhsSlot, bright, a.clip);
}

Tensor UpscalerBuilder::conv3x3(const std::string& name, const Tensor& in, bool relu,
                                const std::optional<Tensor>& residual) {
  const Tensor out = tensor(name, height, width, a.features);
  Conv2dOptions options{.kernel = 3, .relu = relu};
  if (residual) options.residuals = {*residual};
  conv(name, in, out, options);
  return out;
}

void UpscalerBuilder::finish(Tensor x) {
  std::vector<Conv2dLink> links;
  for (uint32_t i = 0; i < a.levels(); ++i)
    x = shuffled(links, fmt::format("up.{}", i), x, 2, a.features, {.kernel = 3});
  const Tensor rec = tensor("rec", a.scale * height, a.scale * width, 3);
  links.push_back(link("rec", x, rec, {.kernel = 3}));
  conv2d_chain(graph, links);
  decode(graph, "decode", rec, {a.transfer, &lrhs, a.scale, phase, &bright, a.clip});
}

uint32_t upscaler_halo(const Architecture& a, uint32_t layers) {
  uint32_t x = a.scale;                                     // rec
  for (uint32_t i = 0; i < a.levels(); ++i) x = x / 2 + 1;  // up.i
  return x + layers;
}

}  // namespace raymeld
