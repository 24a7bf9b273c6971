#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "io/image.h"

namespace raymeld {

// 8-bit sRGB, interleaved: (H, W, 3).
struct Picture {
  int width = 0;
  int height = 0;
  std::vector<uint8_t> rgb;
};

// (3, H, W) scene-linear -> sRGB by Eq. 3 after an exposure of 2^exposure_stops. Throws Error unless RGB.
Picture to_srgb(const Image& linear, float exposure_stops = 0);

// Left to right, with a white bar of `separator` pixels between. Throws Error unless all heights are equal.
Picture side_by_side(std::span<const Picture> pictures, int separator = 4);

// Per-pixel RelMSE (lambda 0.5, 0.01; mean of the channels) of two (3, H, W) images, coloured on a
// logarithmic scale: black at 1e-4 and below, through violet, red and orange to pale yellow at 1 and above;
// NaN is cyan.
Picture error_map(const Image& image, const Image& reference);

// Whole or not at all. Throws Error, naming the file.
void write_png(const std::filesystem::path& path, const Picture& picture);

}  // namespace raymeld
