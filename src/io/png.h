#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "platform/atomic_file.h"
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

// (1, H, W) of errors, such as relmse_map() gives, coloured on a logarithmic scale: black at 1e-4 and below,
// through violet (1e-3), red (1e-2) and orange (1e-1) to pale yellow at 1 and above; NaN is cyan.
Picture heat_map(const Image& errors);

// What a PNG file of it holds. Throws Error.
std::vector<char> png_bytes(const Picture& picture);

// Whole or not at all. Throws Error, naming the file.
void write_png(const std::filesystem::path& path, const Picture& picture);
// The same, without commit().
void write_png(AtomicFile& file, const Picture& picture);

}  // namespace raymeld
