#include "fusion/exposure.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "error.h"

namespace raymeld {

float exposure_of(const float* lrhs, size_t pixels, float key) {
  constexpr std::array<double, 3> kWeights = {0.2126, 0.7152, 0.0722};
  if (key == 0) return 1;
  double sum = 0;
  for (size_t i = 0; i < pixels; ++i) {
    double luminance = 0;
    for (size_t c = 0; c < 3; ++c) {
      const float color = lrhs[c * pixels + i];
      luminance += kWeights[c] * (std::isnan(color) ? 0 : std::clamp(color, 0.0f, 65504.0f));
    }
    sum += std::sqrt(luminance);
  }
  const double mean = sum / static_cast<double>(pixels);
  if (mean == 0) return 1;
  return static_cast<float>(std::clamp(key / (mean * mean), double{kLeastExposure}, double{kMostExposure}));
}

void check_exposure(float exposure) {
  if (exposure >= kLeastExposure && exposure <= kMostExposure) return;
  throw Error("an exposure of {}, expected one from {} to {}", exposure, kLeastExposure, kMostExposure);
}

}  // namespace raymeld
