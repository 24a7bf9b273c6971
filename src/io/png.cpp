#include "io/png.h"

#include <png.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "error.h"
#include "platform/atomic_file.h"

namespace raymeld {
namespace {

uint8_t to_8_bit(float value) { return uint8_t(std::lround(value * 255)); }

using Colour = std::array<float, 3>;  // sRGB, 0 to 255

// Luminance rises evenly along the ramp, so that it reads in grey too.
constexpr std::array<Colour, 5> kRamp = {
    {{0, 0, 0}, {72, 14, 112}, {190, 46, 84}, {246, 142, 30}, {252, 250, 190}}};
constexpr Colour kNanColour = {0, 255, 255};
constexpr double kRampDecades = 4;  // 1e-4 to 1

Colour ramp_colour(double error) {
  if (std::isnan(error)) return kNanColour;
  const double share = std::clamp(std::log10(std::max(error, 1e-30)) / kRampDecades + 1, 0.0, 1.0);
  const double position = share * double(kRamp.size() - 1);
  const size_t below = std::min(size_t(position), kRamp.size() - 2);
  const float t = float(position - double(below));
  Colour colour;
  for (int c = 0; c < 3; ++c) colour[c] = kRamp[below][c] * (1 - t) + kRamp[below + 1][c] * t;
  return colour;
}

}  // namespace

Picture to_srgb(const Image& linear, float exposure_stops) {
  if (linear.channels != 3) throw Error("a preview needs 3 channels, and the image has {}", linear.channels);
  Picture picture{linear.width, linear.height, std::vector<uint8_t>(linear.data.size())};
  const float gain = std::exp2(exposure_stops);
  for (int c = 0; c < 3; ++c)
    for (size_t i = 0; i < linear.plane_size(); ++i)
      picture.rgb[3 * i + size_t(c)] = to_8_bit(linear_to_srgb(linear.plane(c)[i] * gain));
  return picture;
}

Picture side_by_side(std::span<const Picture> pictures, int separator) {
  if (pictures.empty()) throw Error("there are no pictures to put side by side");
  const int height = pictures.front().height;
  int width = separator * (int(pictures.size()) - 1);
  for (const Picture& picture : pictures) {
    if (picture.height != height)
      throw Error("cannot put pictures of heights {} and {} side by side", height, picture.height);
    width += picture.width;
  }
  Picture result{width, height, std::vector<uint8_t>(size_t(width) * size_t(height) * 3, 255)};
  int left = 0;
  for (const Picture& picture : pictures) {
    for (size_t y = 0; y < size_t(height); ++y)
      std::copy_n(picture.rgb.begin() + std::ptrdiff_t(y * size_t(picture.width) * 3), picture.width * 3,
                  result.rgb.begin() + std::ptrdiff_t((y * size_t(width) + size_t(left)) * 3));
    left += picture.width + separator;
  }
  return result;
}

Picture heat_map(const Image& errors) {
  if (errors.channels != 1) throw Error("a heat map needs 1 channel, and the image has {}", errors.channels);
  Picture picture{errors.width, errors.height, std::vector<uint8_t>(errors.data.size() * 3)};
  for (size_t i = 0; i < errors.data.size(); ++i) {
    const Colour colour = ramp_colour(errors.data[i]);
    for (size_t c = 0; c < 3; ++c) picture.rgb[3 * i + c] = uint8_t(std::lround(colour[c]));
  }
  return picture;
}

void write_png(const std::filesystem::path& path, const Picture& picture) {
  AtomicFile file(path);
  write_png(file, picture);
  file.commit();
}

std::vector<char> png_bytes(const Picture& picture) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = png_uint_32(picture.width);
  image.height = png_uint_32(picture.height);
  // libpng takes 8-bit RGB for sRGB, and says so in the file.
  image.format = PNG_FORMAT_RGB;
  png_alloc_size_t size_bytes = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::vector<char> bytes(size_bytes);
  if (!png_image_write_to_memory(&image, bytes.data(), &size_bytes, 0, picture.rgb.data(), 0, nullptr))
    throw Error("cannot make a PNG: {}", image.message);
  bytes.resize(size_bytes);
  return bytes;
}

void write_png(AtomicFile& file, const Picture& picture) {
  std::vector<char> bytes;
  try {
    bytes = png_bytes(picture);
  } catch (const Error& error) {
    throw Error("cannot write '{}': {}", file.path().string(), error.what());
  }
  file.write(bytes.data(), bytes.size());
}

}  // namespace raymeld
