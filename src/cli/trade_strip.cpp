// Pictures of images and their errors.
#include <algorithm>

#include "cli/trade.h"
#include "metrics.h"

namespace raymeld::cli {
namespace {

constexpr int kMostSide = 256, kStep = 32;

// The window of that size with the largest sum of a (1, H, W).
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

Image part_of(const Image& image, Imath::V2i corner, int width, int height) {
  Image part(width, height, image.channels);
  for (int c = 0; c < image.channels; ++c)
    for (int row = 0; row < height; ++row)
      std::copy_n(&image.plane(c)[size_t(corner.y + row) * size_t(image.width) + size_t(corner.x)], width,
                  &part.at(c, row, 0));
  return part;
}

Picture strip_of(const std::vector<Image>& images, const Image& reference, const Image& judged) {
  const int width = std::min(kMostSide, reference.width), height = std::min(kMostSide, reference.height);
  const Imath::V2i corner = worst_window(relmse_map(judged, reference), width, height);
  const Image truth = part_of(reference, corner, width, height);
  std::vector<Picture> above, below;
  for (const Image& image : images) {
    const Image part = part_of(image, corner, width, height);
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
