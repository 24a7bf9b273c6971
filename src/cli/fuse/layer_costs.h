// Lists how much quality is lost without a layer of HRLS that the model takes.
#pragma once

#include <array>
#include <string_view>

namespace raymeld::cli {

struct LayerCost {
  std::string_view layer;
  double db = 0;  // loss of PSNR
};

// These were measured with x4-balanced on the pair in data/ (33.97 dB with all layers) by `raymeld fuse
// --reference`, with each layer alone taken out of HRLS. The x4-fast of then lost the same to within 0.05 dB.
inline constexpr std::array<LayerCost, 4> kLayerCosts = {
    {{"albedo", 0.77}, {"normal", 0.12}, {"diffuse", 0.02}, {"specular", 0.09}}};

// This is the loss without all these layers on the test set's 16 views (docs/quality.md, "given RGB only").
inline constexpr double kAllLayersCostDb = 1.6;

}  // namespace raymeld::cli
