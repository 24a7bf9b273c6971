#include "io/png.h"

#include <gtest/gtest.h>
#include <png.h>

#include <limits>

#include "error_of.h"
#include "support.h"

namespace raymeld {
namespace {

using test::TemporaryDirectory;

struct Decoded {
  int width = 0, height = 0, colour_type = 0, bit_depth = 0;
  bool is_srgb = false;
  std::vector<uint8_t> rgb;
};

// Decodes by another of libpng's interfaces than the one that writes.
Decoded decode(const std::filesystem::path& path) {
  Decoded result;
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (!file) return result;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file);
  png_read_png(png, info, PNG_TRANSFORM_IDENTITY, nullptr);
  result.width = int(png_get_image_width(png, info));
  result.height = int(png_get_image_height(png, info));
  result.colour_type = png_get_color_type(png, info);
  result.bit_depth = png_get_bit_depth(png, info);
  result.is_srgb = png_get_valid(png, info, PNG_INFO_sRGB) != 0;
  png_bytepp rows = png_get_rows(png, info);
  for (int y = 0; y < result.height; ++y)
    result.rgb.insert(result.rgb.end(), rows[y], rows[y] + 3 * result.width);
  png_destroy_read_struct(&png, &info, nullptr);
  std::fclose(file);
  return result;
}

Image rgb_pixels(std::vector<std::array<float, 3>> pixels) {
  Image image(int(pixels.size()), 1, 3);
  for (size_t x = 0; x < pixels.size(); ++x)
    for (int c = 0; c < 3; ++c) image.at(c, 0, int(x)) = pixels[x][c];
  return image;
}

TEST(Png, SrgbByEquation3) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Picture picture =
      to_srgb(rgb_pixels({{0.18f, 0, 1}, {-2, 70000, 0.5f}, {nan, 0.0031308f, 0.214041f}}));
  // Times 255, the sRGB values 0.461356, 0.735357, 0.04045 and 0.5 are 117.6, 187.5, 10.3 and 127.5. The
  // linear value of sRGB 0.5 is 0.214041.
  EXPECT_EQ(picture.rgb[0], 118);
  EXPECT_EQ(picture.rgb[1], 0);
  EXPECT_EQ(picture.rgb[2], 255);
  EXPECT_EQ(picture.rgb[3], 0);
  EXPECT_EQ(picture.rgb[4], 255);
  EXPECT_NEAR(picture.rgb[5], 187.5, 0.5);
  EXPECT_EQ(picture.rgb[6], 0);
  EXPECT_EQ(picture.rgb[7], 10);
  EXPECT_NEAR(picture.rgb[8], 127.5, 0.5);
}

TEST(Png, ExposureIsInStops) {
  const Picture picture = to_srgb(rgb_pixels({{0.045f, 0.09f, 0.72f}}), 2);
  EXPECT_EQ(picture.rgb[0], 118);  // 0.045 * 4 = 0.18
  EXPECT_EQ(picture.rgb[2], 255);
  EXPECT_EQ(to_srgb(rgb_pixels({{0.72f, 0, 0}}), -2).rgb[0], 118);
}

TEST(Png, RoundTrip) {
  TemporaryDirectory directory;
  Picture picture{3, 2, {1, 2, 3, 40, 50, 60, 255, 0, 128, 7, 8, 9, 10, 11, 12, 200, 201, 202}};
  write_png(directory / "a.png", picture);
  const Decoded read = decode(directory / "a.png");
  EXPECT_EQ(read.width, 3);
  EXPECT_EQ(read.height, 2);
  EXPECT_EQ(read.colour_type, PNG_COLOR_TYPE_RGB);
  EXPECT_EQ(read.bit_depth, 8);
  EXPECT_TRUE(read.is_srgb);
  EXPECT_EQ(read.rgb, picture.rgb);
}

TEST(Png, LeavesNothingBehindOnAnError) {
  TemporaryDirectory directory;
  const Picture picture{1, 1, {1, 2, 3}};
  std::filesystem::create_directory(directory / "folder.png");
  EXPECT_ERROR(write_png(directory / "folder.png", picture), "folder.png", "it is a folder");
  EXPECT_ERROR(write_png(directory / "none" / "a.png", picture), "none/a.png", "No such file or directory");
  EXPECT_ERROR(write_png(directory / "a.png", {}), "a.png");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(directory.path()), {}), 1);
}

TEST(Png, SideBySide) {
  const Picture left{1, 2, {1, 1, 1, 2, 2, 2}};
  const Picture right{2, 2, {3, 3, 3, 4, 4, 4, 5, 5, 5, 6, 6, 6}};
  const Picture both = side_by_side(std::array{left, right}, 1);
  EXPECT_EQ(both.width, 4);
  EXPECT_EQ(both.height, 2);
  EXPECT_EQ(both.rgb, (std::vector<uint8_t>{1, 1, 1, 255, 255, 255, 3, 3, 3, 4, 4, 4,  //
                                            2, 2, 2, 255, 255, 255, 5, 5, 5, 6, 6, 6}));
  const Picture low{1, 1, {0, 0, 0}};
  EXPECT_ERROR(side_by_side(std::array{left, low}), "heights 2 and 1");
}

TEST(Png, HeatMapIsLogarithmic) {
  Image errors(8, 1, 1);
  errors.data = {0, 1e-4f, 1e-3f, 1e-2f, 1e-1f, 1, 1e6f, std::numeric_limits<float>::quiet_NaN()};
  const Picture picture = heat_map(errors);
  const std::vector<uint8_t> expected = {0,   0,   0,  0,   0,   0,   72,  14,  112, 190, 46,  84,
                                         246, 142, 30, 252, 250, 190, 252, 250, 190, 0,   255, 255};
  ASSERT_EQ(picture.rgb.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(picture.rgb[i], expected[i], 1) << i;
}

TEST(Png, HeatMapBrightensWithTheError) {
  Image errors(200, 1, 1);
  for (int x = 0; x < 200; ++x) errors.at(0, 0, x) = std::pow(10.0f, -4 + 4 * float(x) / 199);
  const Picture picture = heat_map(errors);
  double before = -1;
  for (size_t x = 0; x < 200; ++x) {
    const uint8_t* rgb = &picture.rgb[3 * x];
    const double luma = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    EXPECT_GE(luma, before - 0.5) << x;
    before = luma;
  }
}

TEST(Png, NeedsRgb) {
  EXPECT_ERROR(to_srgb(Image(2, 2, 1)), "3 channels");
  EXPECT_ERROR(heat_map(Image(2, 2, 3)), "1 channel");
}

}  // namespace
}  // namespace raymeld
