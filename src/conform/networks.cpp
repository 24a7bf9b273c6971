#include <fmt/format.h>

#include <array>

#include "conform/network.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Architecture;

struct Variant {
  Architecture architecture;
  int height, width;  // the size of LRHS
};

// Returns architectures that cover every choice of a model's file. The index of a variant chooses its phase:
// each base, and each choice that depends on the sampling of LRHS, is at an even and at an odd index.
std::vector<Variant> variants() {
  using enum reference::LayerKind;
  using enum reference::Base;
  constexpr auto kLog = reference::Transfer::kLog;
  return {
      {.architecture = {.scale = 2,
                        .features = 1,
                        .growth = 1,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance},
                        .clip = 100},
       .height = 1,
       .width = 1},
      {.architecture = {.scale = 4,
                        .features = 9,
                        .growth = 5,
                        .dense_layers = 2,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance, kAlbedo},
                        .long_skip_fused = true,
                        .base = kBilinear,
                        .transfer = kLog,
                        .clip = 1000},
       .height = 1,
       .width = 7},
      {.architecture = {.scale = 8,
                        .features = 3,
                        .growth = 4,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 2,
                        .hrls_layers = {kRadiance, kNormal, kRadiance},
                        .merge_relu = true,
                        .base = kBilinear,
                        .clip = 10},
       .height = 1,
       .width = 1},
      {.architecture = {.scale = 2,
                        .features = 8,
                        .growth = 9,
                        .dense_layers = 3,
                        .blocks = 2,
                        .groups = 1,
                        .hrls_layers = {kRadiance, kAlbedo, kNormal, kRadiance, kRadiance, kVariance},
                        .long_skip_fused = true,
                        .merge_relu = true,
                        .base = kBilinear,
                        .clip = 100},
       .height = 9,
       .width = 5},
      {.architecture = {.scale = 4,
                        .features = 4,
                        .growth = 3,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 3,
                        .hrls_layers = {kRadiance, kAlbedo, kNormal},
                        .transfer = kLog,
                        .clip = 50},
       .height = 9,
       .width = 5},
      {.architecture = {.scale = 8,
                        .features = 5,
                        .growth = 2,
                        .dense_layers = 2,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance},
                        .long_skip_fused = true,
                        .merge_relu = true,
                        .transfer = kLog,
                        .clip = 1000},
       .height = 1,
       .width = 7},
      {.architecture = {.scale = 2,
                        .features = 3,
                        .growth = 2,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance},
                        .base = kBilinear,
                        .transfer = kLog,
                        .clip = 100,
                        .hrls_unshuffled = true,
                        .hrls_guide = true,
                        .both_samplings = true,
                        .upscale = reference::Upscale::kDirect,
                        .upscaled_features = 5},
       .height = 1,
       .width = 1},
      {.architecture = {.scale = 4,
                        .features = 5,
                        .growth = 3,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance, kNormal},
                        .long_skip_fused = true,
                        .base = kBilinear,
                        .transfer = kLog,
                        .clip = 100,
                        .hrls_unshuffled = true,
                        .both_samplings = true,
                        .upscale = reference::Upscale::kHalf,
                        .half_features = 3,
                        .half_layers = 2,
                        .upscaled_features = 2,
                        .head_features = 3,
                        .head_layers = 2},
       .height = 1,
       .width = 7},
      {.architecture = {.scale = 8,
                        .features = 2,
                        .growth = 3,
                        .dense_layers = 1,
                        .blocks = 2,
                        .groups = 1,
                        .hrls_layers = {kRadiance},
                        .merge_relu = true,
                        .clip = 10,
                        .upscale = reference::Upscale::kDirect,
                        .upscaled_features = 1,
                        .head_features = 4,
                        .head_layers = 1},
       .height = 3,
       .width = 1},
      {.architecture = {.scale = 4,
                        .features = 4,
                        .growth = 2,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 2,
                        .hrls_layers = {kRadiance, kAlbedo},
                        .base = kBilinear,
                        .clip = 50,
                        .hrls_unshuffled = true,
                        .both_samplings = true,
                        .head_features = 9,
                        .head_layers = 1},
       .height = 9,
       .width = 5},
      // These have the joint base.
      {.architecture = {.scale = 2,
                        .features = 3,
                        .growth = 2,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance, kNormal, kAlbedo},
                        .base = kJoint,
                        .clip = 30},
       .height = 9,
       .width = 5},
      {.architecture = {.scale = 4,
                        .features = 4,
                        .growth = 2,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance, kAlbedo, kNormal, kVariance},
                        .long_skip_fused = true,
                        .base = kJoint,
                        .transfer = kLog,
                        .clip = 1000,
                        .hrls_unshuffled = true,
                        .hrls_guide = true,
                        .both_samplings = true,
                        .upscale = reference::Upscale::kDirect,
                        .upscaled_features = 3,
                        .head_features = 5,
                        .head_layers = 3,
                        .lrhs_certainty = 20,
                        .hrls_kernel = 1},
       .height = 1,
       .width = 7},
      {.architecture = {.scale = 8,
                        .features = 3,
                        .growth = 2,
                        .dense_layers = 1,
                        .blocks = 1,
                        .groups = 1,
                        .hrls_layers = {kRadiance, kRadiance, kAlbedo, kNormal},
                        .base = kJoint,
                        .transfer = kLog,
                        .clip = 100,
                        .joint_widths = {1, 0.5, 2, 3, 1, 1, 1.5, 0.7, 1, 6, 2, 0.8, 8, 2, 1}},
       .height = 1,
       .width = 1},
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
    subject.lrhs.at(0, 0, 0) = float(2 * a.clip / exposure);  // half of it is above the clip
    const std::string name = fmt::format("{}: x{}, {} features, phase {:g}, {} x {}", i, a.scale, a.features,
                                         phase, height, width);
    // A quick test runs each method once in each precision, and the network with the joint base by address.
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
