#include "fusion/cut_finder.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace raymeld {
namespace {

constexpr int kCell = 4;
// A cell agrees with another one if no channel differs by more. Guides of one sample a pixel differ by about
// a third of that on fine detail; two stops of brightness are more than the noise of one sample.
constexpr float kMostAlbedo = 0.15f, kMostNormal = 0.3f, kMostStops = 2;
// A frame goes on with the last one if a third of the cells that lie in both agree, and these are an eighth
// of all. Cells without a surface are alike in any two shots, and do not count.
constexpr size_t kAgreeingPart = 3, kSeenPart = 8;

// Returns the mean of a plane over the part of a cell; cells of the full size cover `scale` times as much.
float mean_of(const Image& image, int channel, int y, int x, int scale) {
  const int y0 = y * kCell / scale, y1 = std::max(y0 + 1, (y + 1) * kCell / scale);
  const int x0 = x * kCell / scale, x1 = std::max(x0 + 1, (x + 1) * kCell / scale);
  float sum = 0;
  for (int row = y0; row < y1; ++row)
    for (int column = x0; column < x1; ++column) sum += image.at(channel, row, column);
  return sum / float((y1 - y0) * (x1 - x0));
}

bool is_empty(const Image& cells, int y, int x) {
  for (int c = 0; c < cells.channels; ++c)
    if (cells.at(c, y, x) != 0) return false;
  return true;
}

// Returns the layers that cells are compared by, divided by the most that they may differ; one more channel
// holds log2 of the brightness if there is none.
Image cells_of(const Image& lrhs, const Image& hrls, std::span<const std::string> layers) {
  std::vector<std::pair<int, float>> channels;  // a channel of HRLS, and the most that it may differ by
  for (size_t i = 0; i < layers.size(); ++i) {
    if (layers[i] != "albedo" && layers[i] != "normal") continue;
    for (int c = 0; c < 3; ++c)
      channels.emplace_back(3 * int(i) + c, layers[i] == "albedo" ? kMostAlbedo : kMostNormal);
  }
  const int scale = hrls.width / lrhs.width;
  Image cells(hrls.width / kCell, hrls.height / kCell, std::max(int(channels.size()), 1));
  for (int y = 0; y < cells.height; ++y) {
    for (int x = 0; x < cells.width; ++x) {
      for (size_t i = 0; i < channels.size(); ++i)
        cells.at(int(i), y, x) = mean_of(hrls, channels[i].first, y, x, 1) / channels[i].second;
      if (!channels.empty()) continue;
      float sum = 0;
      for (int c = 0; c < 3; ++c) sum += mean_of(lrhs, c, y, x, scale);
      cells.at(0, y, x) = std::log2(std::max(sum, 1e-6f)) / kMostStops;
    }
  }
  return cells;
}

}  // namespace

bool CutFinder::is_cut(const Image& lrhs, const Image& hrls, std::span<const std::string> layers,
                       const Image& motion) {
  if (hrls.width < kCell || hrls.height < kCell) return false;
  const Image last = std::exchange(last_, cells_of(lrhs, hrls, layers));
  if (last.data.empty()) return false;
  if (last.width != last_.width || last.height != last_.height || last.channels != last_.channels)
    return true;
  size_t all = 0, seen = 0, agreeing = 0;
  for (int y = 0; y < last.height; ++y) {
    for (int x = 0; x < last.width; ++x) {
      const int at_y = kCell * y + kCell / 2, at_x = kCell * x + kCell / 2;
      const float from_y = std::floor((float(at_y) + motion.at(1, at_y, at_x)) / kCell);
      const float from_x = std::floor((float(at_x) + motion.at(0, at_y, at_x)) / kCell);
      const auto is_within = [](float at, int size) { return at >= 0 && at < float(size); };  // NaN is not
      const bool is_seen = is_within(from_y, last.height) && is_within(from_x, last.width);
      if (is_empty(last_, y, x) && (!is_seen || is_empty(last, int(from_y), int(from_x)))) continue;
      ++all;
      if (!is_seen) continue;
      ++seen;
      bool agrees = true;
      for (int c = 0; c < last.channels; ++c)
        agrees &= std::abs(last_.at(c, y, x) - last.at(c, int(from_y), int(from_x))) <= 1;
      agreeing += agrees;
    }
  }
  return kSeenPart * seen < all || kAgreeingPart * agreeing < seen;
}

}  // namespace raymeld
