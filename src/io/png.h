#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "io/image.h"
#include "platform/atomic_file.h"

namespace raymeld {

// Holds 8-bit sRGB, interleaved: (H, W, 3).
struct Picture {
  int width = 0;
  int height = 0;
  std::vector<uint8_t> rgb;
};

// Converts (3, H, W) scene-linear to sRGB by Eq. 3, after an exposure of 2^exposure_stops. Throws Error
// unless `linear` has 3 channels.
Picture to_srgb(const Image& linear, float exposure_stops = 0);

// Puts pictures side by side from left to right, with a white bar of `separator` pixels between them. Throws
// Error unless there are pictures and all heights are equal.
Picture side_by_side(std::span<const Picture> pictures, int separator = 4);

// Colours errors (1, H, W), such as those of relmse_map(), on a logarithmic scale: black at 1e-4 and below,
// through violet (1e-3), red (1e-2) and orange (1e-1) to pale yellow at 1 and above; NaN is cyan.
Picture heat_map(const Image& errors);

// Returns the content of a PNG file of the picture. Throws Error.
std::vector<char> png_bytes(const Picture& picture);

// Writes a PNG file, whole or not at all. Throws an Error that names the file.
void write_png(const std::filesystem::path& path, const Picture& picture);
// Does the same without commit().
void write_png(AtomicFile& file, const Picture& picture);

}  // namespace raymeld
