#include "conform/conform.h"

#include "conform/suites.h"

namespace raymeld::conform {

std::span<const Suite> suites() {
  static const std::vector<Suite> all{{"conv2d", conform_conv2d},        {"exposure", conform_exposure},
                                      {"encode", conform_encode},        {"decode", conform_decode},
                                      {"shuffles", conform_shuffles},    {"joint", conform_joint},
                                      {"network", conform_network, true}};
  return all;
}

void conform(const Suite& suite, const Target& target, const Options& options) {
  Collector collector(target, options);
  suite.run(collector);
}

}  // namespace raymeld::conform
