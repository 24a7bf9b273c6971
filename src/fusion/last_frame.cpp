#include "fusion/last_frame.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace raymeld {

LastFrame::LastFrame(TileSize frame, uint32_t scale, uint32_t hrls_channels)
    : frame_(frame), scale_(scale), changed_(size_t{frame.height} * frame.width), distrusted_(changed_) {
  const size_t full = changed_.size() * scale * scale;
  lrhs_.resize(3 * changed_.size());
  hrls_.resize(hrls_channels * full);
  fused_.resize(3 * full);
}

void LastFrame::begin(const float* lrhs, const float* hrls, float exposure) {
  const bool knows = whole_ && exposure == exposure_;
  whole_ = false;
  exposure_ = exposure;
  changed_.swap(distrusted_);
  std::ranges::fill(distrusted_, 0);
  take(lrhs, lrhs_, 1);
  take(hrls, hrls_, scale_);
  if (!knows) change_all();
}

// Compares whole rows first: when little of a frame changed, most of its rows did not.
void LastFrame::take(const float* image, std::vector<float>& last, uint32_t scale) {
  const size_t width = size_t{frame_.width} * scale, height = size_t{frame_.height} * scale;
  for (size_t row = 0; row < last.size() / width; ++row) {
    const float* const from = image + row * width;
    float* const to = last.data() + row * width;
    if (std::memcmp(from, to, width * sizeof(float)) == 0) continue;
    uint8_t* const changed = changed_.data() + row % height / scale * frame_.width;
    for (size_t x = 0; x < width; ++x)
      changed[x / scale] |= std::bit_cast<uint32_t>(from[x]) != std::bit_cast<uint32_t>(to[x]);
    std::copy_n(from, width, to);
  }
}

void LastFrame::change_all() { std::ranges::fill(changed_, 1); }

void LastFrame::distrust(const Tile& at, TileSize tile) {
  for (uint32_t y = at.y; y < at.y + tile.height; ++y)
    std::fill_n(distrusted_.begin() + ptrdiff_t(y) * frame_.width + at.x, tile.width, 1);
}

bool LastFrame::has_changed(const Tile& at, TileSize tile) const {
  for (uint32_t y = at.y; y < at.y + tile.height; ++y) {
    const auto row = changed_.begin() + ptrdiff_t(y) * frame_.width + at.x;
    if (std::find(row, row + tile.width, 1) != row + tile.width) return true;
  }
  return false;
}

void LastFrame::end() { whole_ = true; }

}  // namespace raymeld
