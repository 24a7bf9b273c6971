#include "io/image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "error_of.h"

namespace raymeld {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

Image ramp(int width, int height, int channels) {
  Image image(width, height, channels);
  for (int c = 0; c < channels; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) image.at(c, y, x) = float(100 * c + 10 * y + x);
  return image;
}

TEST(Image, IsPlanarAndRowMajor) {
  const Image image = ramp(3, 2, 2);
  EXPECT_EQ(image.data, (std::vector<float>{0, 1, 2, 10, 11, 12, 100, 101, 102, 110, 111, 112}));
  EXPECT_EQ(image.plane(1)[4], 111);
}

TEST(Image, RefusesEmptySizes) {
  EXPECT_ERROR(Image(0, 4, 3), "0 x 4");
  EXPECT_ERROR(Image(4, -1, 3), "4 x -1");
}

// Keys' kernel with a = -0.5 keeps straight lines straight wherever its four samples are.
TEST(Image, BicubicKeepsALinearRampForBothPhases) {
  const Image low = ramp(8, 7, 2);
  for (int scale : {2, 4, 8}) {
    for (float phase : {0.0f, float(scale - 1) / 2}) {
      const Image high = upsample_bicubic(low, scale, phase);
      ASSERT_EQ(high.width, 8 * scale);
      ASSERT_EQ(high.height, 7 * scale);
      for (int c = 0; c < 2; ++c)
        for (int y = 2 * scale; y < 5 * scale; ++y)
          for (int x = 2 * scale; x < 6 * scale; ++x)
            ASSERT_NEAR(high.at(c, y, x), 100 * c + 10 * (y - phase) / scale + (x - phase) / scale, 1e-4)
                << "scale " << scale << " phase " << phase << " at " << x << ", " << y;
    }
  }
}

TEST(Image, BilinearIsTheMeanOfNeighbours) {
  Image low(2, 1, 1);
  low.data = {1, 3};
  const Image high = upsample_bilinear(low, 2, 0.5f);
  EXPECT_EQ(high.data, (std::vector<float>{1, 1.5f, 2.5f, 3, 1, 1.5f, 2.5f, 3}));
}

TEST(Image, BicubicOfPhase0GoesThroughTheSamples) {
  Image low(4, 4, 1);
  for (int i = 0; i < 16; ++i) low.data[i] = float((i * 7) % 11);
  const Image high = upsample_bicubic(low, 4, 0);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 4; ++x) EXPECT_EQ(high.at(0, 4 * y, 4 * x), low.at(0, y, x));
}

TEST(Image, BicubicOfAnImpulse) {
  Image low(9, 1, 1);
  low.at(0, 0, 4) = 1;
  const Image high = upsample_bicubic(low, 2, 0);
  // The kernel is 1, 0.5625, 0, -0.0625, 0 at distances 0, 1/2, 1, 3/2, 2.
  EXPECT_FLOAT_EQ(high.at(0, 0, 8), 1);
  EXPECT_FLOAT_EQ(high.at(0, 1, 9), 0.5625f);
  EXPECT_FLOAT_EQ(high.at(0, 0, 10), 0);
  EXPECT_FLOAT_EQ(high.at(0, 0, 11), -0.0625f);
  EXPECT_FLOAT_EQ(high.at(0, 0, 5), -0.0625f);
  EXPECT_FLOAT_EQ(high.at(0, 0, 12), 0);
}

TEST(Image, BicubicReplicatesEdges) {
  Image low(1, 1, 3);
  low.data = {1, 2, 3};
  const Image high = upsample_bicubic(low, 8, 3.5f);
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < 64; ++i) EXPECT_FLOAT_EQ(high.plane(c)[i], float(c + 1));
}

TEST(Image, Equation3) {
  EXPECT_EQ(linear_to_srgb(-1), 0);
  EXPECT_EQ(linear_to_srgb(0), 0);
  EXPECT_EQ(linear_to_srgb(kNaN), 0);
  EXPECT_FLOAT_EQ(linear_to_srgb(0.001f), 0.01292f);
  EXPECT_NEAR(linear_to_srgb(0.0031308f), 0.0404499, 1e-6);  // both pieces meet here
  EXPECT_NEAR(linear_to_srgb(0.0031309f), 0.0404512, 2e-6);
  EXPECT_NEAR(linear_to_srgb(0.01f), 0.0998528, 1e-6);
  EXPECT_NEAR(linear_to_srgb(0.18f), 0.461356, 1e-5);
  EXPECT_NEAR(linear_to_srgb(0.5f), 0.735357, 1e-5);
  EXPECT_NEAR(linear_to_srgb(0.999999f), 1, 1e-6);
  EXPECT_EQ(linear_to_srgb(1), 1);
  EXPECT_EQ(linear_to_srgb(kInf), 1);
}

TEST(Image, SanitizeCountsAndReplaces) {
  Image image(3, 2, 1);
  image.data = {kNaN, kInf, -kInf, 1e9f, -0.5f, kNaN};
  const NonFinite found = sanitize(image);
  EXPECT_EQ(found.nan, 2u);
  EXPECT_EQ(found.inf, 2u);
  EXPECT_EQ(image.data, (std::vector<float>{0, 65504, -65504, 1e9f, -0.5f, 0}));
}

TEST(Image, VarianceOfAStep) {
  Image image(4, 3, 2);
  for (int y = 0; y < 3; ++y)
    for (int x = 2; x < 4; ++x) image.at(0, y, x) = 3;
  const Image variance = variance_3x3(image);
  for (int y = 0; y < 3; ++y) {
    // If 3 of 9 values are 3, the mean is 1 and the variance (6 * 1 + 3 * 4) / 9 = 2. If 6 of 9 are, the mean
    // is 2 and the variance (3 * 4 + 6 * 1) / 9 = 2.
    EXPECT_FLOAT_EQ(variance.at(0, y, 0), 0);
    EXPECT_FLOAT_EQ(variance.at(0, y, 1), 2);
    EXPECT_FLOAT_EQ(variance.at(0, y, 2), 2);
    EXPECT_FLOAT_EQ(variance.at(0, y, 3), 0);
    EXPECT_FLOAT_EQ(variance.at(1, y, 1), 0);
  }
}

TEST(Image, VarianceReplicatesEdges) {
  Image image(1, 2, 1);
  image.data = {9, 0};
  // The row above repeats, so there are six 9s and three 0s: the mean is 6, and (6 * 9 + 3 * 36) / 9 = 18.
  EXPECT_FLOAT_EQ(variance_3x3(image).at(0, 0, 0), 18);
  EXPECT_FLOAT_EQ(variance_3x3(image).at(0, 1, 0), 18);
}

TEST(Image, VarianceTakesNonFiniteForZeroAndLosesNoDigitsOnALargeMean) {
  Image image(3, 3, 1);
  image.data = {kNaN, kInf, -kInf, 0, 9, 0, 0, 0, 0};
  EXPECT_FLOAT_EQ(variance_3x3(image).at(0, 1, 1), 8);  // mean 1, (64 + 8) / 9
  for (float& value : image.data) value = 8388608;      // 2^23; a sum of squares in float would drown the +-1
  image.data[0] = 8388609, image.data[8] = 8388607;
  EXPECT_FLOAT_EQ(variance_3x3(image).at(0, 1, 1), 2.0f / 9);
  for (float& value : image.data) value = 0;
  image.data[4] = std::numeric_limits<float>::max();
  EXPECT_TRUE(std::isfinite(variance_3x3(image).at(0, 1, 1)));
}

}  // namespace
}  // namespace raymeld
