#include "last_frame.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "engine/graph.h"

namespace raymeld {

LastFrame::LastFrame(TileSize frame, uint32_t scale, uint32_t hrls_channels)
    : frame_(frame), scale_(scale), changed_(size_t{frame.height} * frame.width), distrusted_(changed_) {
  const size_t full = changed_.size() * scale * scale;
  lrhs_.resize(3 * changed_.size());
  hrls_.resize(hrls_channels * full);
  fused_.resize(3 * full);
  sums_.resize((size_t{frame.height} + 1) * (frame.width + 1));
}

void LastFrame::begin(const float* lrhs, const float* hrls, float exposure) {
  const bool knows = whole_ && exposure == exposure_;
  whole_ = false;
  exposure_ = exposure;
  changed_.swap(distrusted_);
  std::ranges::fill(distrusted_, 0);
  take(lrhs, lrhs_, 1);
  take(hrls, hrls_, scale_);
  if (knows) {
    count();
  } else {
    change_all();
  }
}

// Most rows of a frame of which little changed are equal.
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

void LastFrame::change_all() {
  std::ranges::fill(changed_, 1);
  count();
}

void LastFrame::distrust(const Tile& at, TileSize tile) {
  for (uint32_t y = at.y; y < at.y + tile.height; ++y)
    std::fill_n(distrusted_.begin() + ptrdiff_t(y) * frame_.width + at.x, tile.width, 1);
}

void LastFrame::count() {
  const size_t stride = frame_.width + 1;
  for (size_t y = 0; y < frame_.height; ++y) {
    uint32_t row = 0;
    for (size_t x = 0; x < frame_.width; ++x) {
      row += changed_[y * frame_.width + x];
      sums_[(y + 1) * stride + x + 1] = sums_[y * stride + x + 1] + row;
    }
  }
}

bool LastFrame::any_changed(uint32_t top, uint32_t left, uint32_t bottom, uint32_t right) const {
  const size_t stride = frame_.width + 1;
  return sums_[bottom * stride + right] - sums_[top * stride + right] !=
         sums_[bottom * stride + left] - sums_[top * stride + left];
}

std::vector<bool> LastFrame::changed_blocks(const Tile& at, TileSize tile, uint32_t reach) const {
  const SparseGrid grid{tile.height, tile.width};
  const auto first = [&](uint32_t block) {
    return block * SparseGrid::kSide - std::min(block * SparseGrid::kSide, reach);
  };
  const auto last = [&](uint32_t block, uint32_t size) {
    return std::min((block + 1) * SparseGrid::kSide + reach, size);
  };
  std::vector<bool> blocks;
  for (uint32_t row = 0; row < grid.rows(); ++row) {
    for (uint32_t column = 0; column < grid.columns(); ++column) {
      blocks.push_back(any_changed(at.y + first(row), at.x + first(column), at.y + last(row, tile.height),
                                   at.x + last(column, tile.width)));
    }
  }
  return blocks;
}

void LastFrame::end() { whole_ = true; }

}  // namespace raymeld
