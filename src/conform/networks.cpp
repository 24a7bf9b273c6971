#include <fmt/format.h>

#include <array>

#include "conform/network.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Architecture;

struct Variant {
  Architecture architecture;
  int height, width;  // of LRHS
};

// Every choice of a model's file at least once; each base and what depends on the sampling of LRHS with an
// even and an odd index, which chooses the phase.
std::vector<Variant> variants() {
  using enum reference::LayerKind;
  using enum reference::Base;
  constexpr auto kLinear = reference::Transfer::kLinear, kLog = reference::Transfer::kLog;
  // scale, C, R, D, B, G, layers, long skip fused, merge ReLU, base, transfer, clip
  return {
      {{2, 1, 1, 1, 1, 1, {kRadiance}, false, false, kNone, kLinear, 100}, 1, 1},
      {{4, 9, 5, 2, 1, 1, {kRadiance, kAlbedo}, true, false, kBilinear, kLog, 1000}, 1, 7},
      {{8, 3, 4, 1, 1, 2, {kRadiance, kNormal, kRadiance}, false, true, kBilinear, kLinear, 10}, 1, 1},
      {{2,
        8,
        9,
        3,
        2,
        1,
        {kRadiance, kAlbedo, kNormal, kRadiance, kRadiance, kVariance},
        true,
        true,
        kBilinear,
        kLinear,
        100},
       9,
       5},
      {{4, 4, 3, 1, 1, 3, {kRadiance, kAlbedo, kNormal}, false, false, kNone, kLog, 50}, 9, 5},
      {{8, 5, 2, 2, 1, 1, {kRadiance}, true, true, kNone, kLog, 1000}, 1, 7},
      // further: unshuffled HRLS, direct upscaling, guide, both samplings, M, head
      {{2, 3, 2, 1, 1, 1, {kRadiance}, false, false, kBilinear, kLog, 100, true, true, true, true, 5, 0},
       1,
       1},
      {{4,
        5,
        3,
        1,
        1,
        1,
        {kRadiance, kNormal},
        true,
        false,
        kBilinear,
        kLog,
        100,
        true,
        true,
        false,
        true,
        2,
        3,
        2},
       1,
       7},
      {{8, 2, 3, 1, 2, 1, {kRadiance}, false, true, kNone, kLinear, 10, false, true, false, false, 1, 4, 1},
       3,
       1},
      {{4,
        4,
        2,
        1,
        1,
        2,
        {kRadiance, kAlbedo},
        false,
        false,
        kBilinear,
        kLinear,
        50,
        true,
        false,
        false,
        true,
        0,
        9,
        1},
       9,
       5},
      // joint base
      {{2, 3, 2, 1, 1, 1, {kRadiance, kNormal, kAlbedo}, false, false, kJoint, kLinear, 30}, 9, 5},
      {{4,    4,     2,      1,    1,    1,    {kRadiance, kAlbedo, kNormal, kVariance},
        true, false, kJoint, kLog, 1000, true, true,
        true, true,  3,      5,    3,    20,   1},
       1,
       7},
      {{8, 3, 2, 1, 1, 1, {kRadiance, kRadiance, kAlbedo, kNormal}, false, false, kJoint, kLog, 100}, 1, 1},
  };
}

}  // namespace

void conform_network(Collector& collector) {
  const std::vector<Variant> all = variants();
  for (size_t i = 0; i < all.size(); i += collector.full() ? 1 : 5) {
    const auto& [a, height, width] = all[i];
    const float phase = i % 2 ? (float(a.scale) - 1) / 2 : 0,
                exposure = std::array{1.0f, 0.037f, 2.3f}[i % 3];
    Subject subject = make_subject(a, height, width, 100 + i);
    subject.lrhs.at(0, 0, 0) = float(2 * a.clip / exposure);  // half of it is a highlight
    const std::string name = fmt::format("{}: x{}, {} features, phase {:g}, {} x {}", i, a.scale, a.features,
                                         phase, height, width);
    // Quick, each way and precision has one network, and that with a joint filter has kernels by address.
    size_t turn = i / 5 * 2;
    Collector::for_each(network_methods(collector.device().info(), i), [&](const Method& method,
                                                                           reference::Precision precision) {
      if (!collector.full() && turn++ % 3 != 0) return;
      conform_one(collector, name, subject,
                  {.method = method, .precision = precision, .phase = phase, .exposure = exposure});
    });
  }
}

}  // namespace raymeld::conform
