#include "settled.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/graph.h"

namespace raymeld {
namespace {

struct Encoder {
  float exposure, clip;
  bool is_log;

  // As encode.comp does.
  float operator()(float radiance) const {
    const float exposed = radiance * exposure;
    const float x = std::isnan(exposed) ? 0 : std::clamp(exposed, 0.0f, clip);
    return is_log ? std::log1p(8 * x) / 3 : x;
  }
};

struct Agreement {
  Encoder encoded;
  const std::vector<float>& lrhs;  // encoded
  const float* hrls;
  TileSize frame;
  uint32_t scale;
  float phase, threshold;

  bool at(uint32_t y, uint32_t x) const {
    const auto place = [&](uint32_t pixel, uint32_t size) {
      return std::clamp((float(pixel) - phase) / float(scale), 0.0f, float(size - 1));
    };
    const float v = place(y, frame.height), u = place(x, frame.width);
    const auto top = uint32_t(v), left = uint32_t(u);
    const uint32_t bottom = std::min(top + 1, frame.height - 1), right = std::min(left + 1, frame.width - 1);
    const size_t low_plane = size_t{frame.height} * frame.width, plane = low_plane * scale * scale;
    for (size_t c = 0; c < 3; ++c) {
      const auto low = [&](uint32_t i, uint32_t j) {
        return lrhs[c * low_plane + size_t{i} * frame.width + j];
      };
      const float upsampled =
          std::lerp(std::lerp(low(top, left), low(top, right), u - float(left)),
                    std::lerp(low(bottom, left), low(bottom, right), u - float(left)), v - float(top));
      const float own = encoded(hrls[c * plane + size_t{y} * scale * frame.width + x]);
      if (!(std::abs(own - upsampled) <= threshold)) return false;
    }
    return true;
  }

  bool in_block(uint32_t row, uint32_t column) const {
    const uint32_t side = SparseGrid::kSide * scale;
    const uint32_t bottom = std::min((row + 1) * side, frame.height * scale),
                   right = std::min((column + 1) * side, frame.width * scale);
    for (uint32_t y = row * side; y < bottom; ++y)
      for (uint32_t x = column * side; x < right; ++x)
        if (!at(y, x)) return false;
    return true;
  }
};

}  // namespace

double settled_share(const Architecture& a, const float* lrhs, const float* hrls, TileSize frame, float phase,
                     float exposure, float threshold) {
  const Encoder encoded{exposure, a.clip, a.transfer == Transfer::kLog};
  std::vector<float> low(lrhs, lrhs + 3 * size_t{frame.height} * frame.width);
  for (float& value : low) value = encoded(value);
  const Agreement agreement{encoded, low, hrls, frame, a.scale, phase, threshold};
  const SparseGrid grid{frame.height, frame.width};
  uint32_t settled = 0;
  for (uint32_t row = 0; row < grid.rows(); ++row)
    for (uint32_t column = 0; column < grid.columns(); ++column) settled += agreement.in_block(row, column);
  return double(settled) / grid.blocks();
}

}  // namespace raymeld
