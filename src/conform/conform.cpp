#include "conform/conform.h"

#include "conform/suites.h"

namespace raymeld::conform {

std::span<const Suite> suites() {
  static const std::vector<Suite> all{
      {.name = "conv2d", .run = conform_conv2d},
      {.name = "exposure", .run = conform_exposure},
      {.name = "encode", .run = conform_encode},
      {.name = "decode", .run = conform_decode},
      {.name = "pyramid", .run = conform_pyramid},
      {.name = "attention", .run = conform_attention},
      {.name = "kpcn", .run = conform_kpcn},
      {.name = "temporal", .run = conform_temporal},
      {.name = "network", .run = conform_network, .networks = true},
  };
  return all;
}

void conform(const Suite& suite, const Target& target, const Options& options) {
  Collector collector(target, options);
  suite.run(collector);
}

}  // namespace raymeld::conform
