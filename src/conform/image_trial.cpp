#include "conform/image_trial.h"

namespace raymeld::conform {
namespace {

void try_layer(const Collector& collector, const ImageLayer& layer, const Method& method,
               reference::Precision precision) {
  constexpr size_t kCombinations = 2 * 3 * 2;  // transfers, scales and phases
  const auto sizes = collector.sizes();
  for (size_t i = 0; i < std::max(kCombinations, sizes.size()); ++i) {
    const int scale = 2 << i % 3;
    const ImageTrial trial{.target = collector.target(),
                           .method = method,
                           .precision = precision,
                           .log = i / 3 % 2 == 1,
                           .scale = scale,
                           .phase = i / 6 % 2 == 1 ? (float(scale) - 1) / 2 : 0,
                           .size = sizes[i % sizes.size()],
                           .seed = i + 1};
    collector.run(layer.name, method, precision, trial.shape(),
                  [&](Check& check) { layer.check(check, trial); });
  }
}

}  // namespace

void try_layers(const Collector& collector, std::span<const ImageLayer> layers) {
  Collector::for_each(plain_methods(), [&](const Method& method, reference::Precision precision) {
    for (const ImageLayer& layer : layers) try_layer(collector, layer, method, precision);
  });
}

}  // namespace raymeld::conform
