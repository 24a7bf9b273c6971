// Builds RCAN (Zhang et al. 2018): groups of residual blocks, each of which scales its channels by attention
// to their means over the whole frame. So a frame is one tile.
#include "networks/network.h"
#include "networks/upscaler.h"

namespace raymeld {
namespace {

// Adds channel attention to `x`, and the residual.
Tensor attended(UpscalerBuilder& build, const std::string& name, const Tensor& x, const Tensor& residual) {
  const uint32_t channels = x.shape.channels;
  const Tensor means = build.tensor(name + ".means", 1, 1, channels);
  channel_means(build.graph, name + ".means", x, means);
  if (build.estimate) build.estimate->add_means(build.graph, x, means);
  const Tensor squeezed = build.tensor(name + ".squeeze", 1, 1, build.a.squeezed_features);
  build.conv(name + ".squeeze", means, squeezed, {.kernel = 1, .relu = true});
  const Tensor logits = build.tensor(name + ".excite", 1, 1, channels);
  build.conv(name + ".excite", squeezed, logits, {.kernel = 1});
  const Tensor out = build.tensor(name + ".attend", build.height, build.width, channels);
  attend(build.graph, name + ".attend", x, logits, residual, out);
  if (build.estimate) build.estimate->add_attended(build.graph, x, logits, residual, out);
  return out;
}

}  // namespace

void parse_rcan(const Entries& entries, Architecture& a) {
  parse_upscaler(entries, a);
  a.blocks = entries.integer("blocks", 1, kMostRepeats);
  a.groups = entries.integer("groups", 1, kMostRepeats);
  a.squeezed_features = entries.integer("squeezed_features", 1, kMostChannels);
}

void add_rcan(Builder builder, uint32_t height, uint32_t width, float phase) {
  UpscalerBuilder build(builder, height, width, phase);
  const Tensor head = build.conv3x3("head", build.lrhs);
  Tensor x = head;
  for (uint32_t g = 0; g < build.a.groups; ++g) {
    const std::string group = fmt::format("groups.{}", g);
    const Tensor group_input = x;
    for (uint32_t b = 0; b < build.a.blocks; ++b) {
      const std::string name = fmt::format("{}.blocks.{}", group, b);
      const Tensor inner = build.conv3x3(name + ".1", build.conv3x3(name + ".0", x, true));
      x = attended(build, name, inner, x);
    }
    x = build.conv3x3(group + ".last", x, false, group_input);
  }
  build.finish(build.conv3x3("body", x, false, head));
}

uint32_t rcan_halo(const Architecture&, bool) { return kWholeFrame; }

}  // namespace raymeld
