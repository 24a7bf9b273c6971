// Builds EDSR (Lim et al. 2017), which upscales LRHS alone: residual blocks without normalisation at LRHS's
// size, then pixel shuffles. A block's residual scaling is part of its last weights. Beyond the paper, the
// output is added to the bilinearly upsampled LRHS, so that the network begins with that.
#include "model/builder.h"

namespace raymeld {

void add_edsr(Builder build, uint32_t height, uint32_t width, float phase) {
  const Architecture& a = build.a;
  Graph& graph = build.graph;
  const Tensor lrhs = build.tensor("encode.lrhs", height, width, 3);
  build.encode_lrhs(lrhs);
  const Tensor bright = build.tensor("above_clip", height, width, 3);
  above_clip(graph, "above_clip", kLrhsSlot, bright, a.clip);

  const auto conv = [&](const std::string& name, const Tensor& in, bool relu,
                        std::optional<Tensor> residual = {}) {
    const Tensor out = build.tensor(name, height, width, a.features);
    Conv2dOptions options{.kernel = 3, .relu = relu};
    if (residual) options.residuals = {*residual};
    build.conv(name, in, out, options);
    return out;
  };
  const Tensor head = conv("head", lrhs, false);
  Tensor x = head;
  for (uint32_t block = 0; block < a.blocks; ++block) {
    const std::string name = fmt::format("blocks.{}", block);
    x = conv(name + ".1", conv(name + ".0", x, true), false, x);
  }
  x = conv("body", x, false, head);

  std::vector<Conv2dLink> links;
  for (uint32_t i = 0; i < a.levels(); ++i)
    x = build.shuffled(links, fmt::format("up.{}", i), x, 2, a.features, {.kernel = 3});
  const Tensor rec = build.tensor("rec", a.scale * height, a.scale * width, 3);
  links.push_back(build.link("rec", x, rec, {.kernel = 3}));
  conv2d_chain(graph, links);
  decode(graph, "decode", rec, {a.transfer, &lrhs, a.scale, phase, &bright, a.clip});
}

}  // namespace raymeld
