// Draws images with their errors.
#include <algorithm>

#include "choice/metrics.h"
#include "cli/trade/trade.h"

namespace raymeld::cli {
namespace {

constexpr int kMostSide = 256, kStep = 32;

Imath::Box2i window_of(const Image& image) { return {{0, 0}, {image.width - 1, image.height - 1}}; }

// Returns the corner of the window of this size with the largest sum of errors, (1, H, W).
Imath::V2i worst_window(const Image& errors, int width, int height) {
  Imath::V2i worst(0, 0);
  double most = -1;
  for (int y = 0; y + height <= errors.height; y += kStep) {
    for (int x = 0; x + width <= errors.width; x += kStep) {
      double sum = 0;
      for (int row = y; row < y + height; ++row)
        for (int column = x; column < x + width; ++column) sum += double(errors.at(0, row, column));
      if (sum > most) most = sum, worst = {x, y};
    }
  }
  return worst;
}

}  // namespace

Picture strip_of(const std::vector<Image>& images, const Image& reference, const Image& judged) {
  const int width = std::min(kMostSide, reference.width), height = std::min(kMostSide, reference.height);
  const Imath::V2i corner = worst_window(relmse_map(judged, reference), width, height);
  const Imath::Box2i shown(corner, corner + Imath::V2i(width - 1, height - 1));
  const Image truth = seen_through(reference, window_of(reference), shown);
  std::vector<Picture> above, below;
  for (const Image& image : images) {
    const Image part = seen_through(image, window_of(image), shown);
    above.push_back(to_srgb(part));
    below.push_back(heat_map(relmse_map(part, truth)));
  }
  Picture strip = side_by_side(above);
  const Picture errors = side_by_side(below);
  strip.rgb.insert(strip.rgb.end(), errors.rgb.begin(), errors.rgb.end());
  strip.height += errors.height;
  return strip;
}

}  // namespace raymeld::cli
