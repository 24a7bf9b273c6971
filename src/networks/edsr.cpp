// Builds EDSR (Lim et al. 2017): residual blocks without normalisation. A block's residual scaling is part of
// its last weights.
#include "networks/upscaler.h"

namespace raymeld {

void parse_edsr(const Entries& entries, Architecture& a) {
  parse_upscaler(entries, a);
  a.blocks = entries.integer("blocks", 1, kMostRepeats);
}

void add_edsr(Builder builder, uint32_t height, uint32_t width, float phase) {
  UpscalerBuilder build(builder, height, width, phase);
  const Tensor head = build.conv3x3("head", build.lrhs);
  Tensor x = head;
  for (uint32_t block = 0; block < build.a.blocks; ++block) {
    const std::string name = fmt::format("blocks.{}", block);
    x = build.conv3x3(name + ".1", build.conv3x3(name + ".0", x, true), false, x);
  }
  build.finish(build.conv3x3("body", x, false, head));
}

uint32_t edsr_halo(const Architecture& a, bool) {
  return upscaler_halo(a, 2 * a.blocks + 2);  // blocks.i, head, body
}

}  // namespace raymeld
