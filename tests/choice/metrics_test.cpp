#include "choice/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "error_of.h"

namespace raymeld {
namespace {

Image constant(int width, int height, float value) {
  Image image(width, height, 3);
  for (float& v : image.data) v = value;
  return image;
}

TEST(Metrics, PsnrSeesNothingBeyondTheRangeOfSrgb) {
  EXPECT_EQ(psnr_srgb(constant(2, 2, 50.0f), constant(2, 2, 1.0f)), std::numeric_limits<double>::infinity());
  EXPECT_EQ(psnr_srgb(constant(2, 2, -3.0f), constant(2, 2, 0.0f)), std::numeric_limits<double>::infinity());
}

TEST(Metrics, PsnrSrgbComparesAfterEquation3) {
  // Linear 0.001 is sRGB 0.01292; its square is 1.6692640e-4, which is 37.774748 dB.
  EXPECT_NEAR(psnr_srgb(constant(5, 2, 0.001f), constant(5, 2, 0.0f)), 37.774748, 1e-4);
  // Linear 0.5 is sRGB 0.735357; 1 - 0.735357 = 0.264643 has the square 0.0700359, which is 11.546793 dB.
  EXPECT_NEAR(psnr_srgb(constant(5, 2, 0.5f), constant(5, 2, 1.0f)), 11.5468, 1e-3);
}

TEST(Metrics, PsnrAveragesOverAllChannels) {
  Image image = constant(1, 1, 0.0f);
  image.at(1, 0, 0) = 1.0f;
  // One of three values is off by 1, so the mse is 1/3, which is 4.771213 dB.
  EXPECT_NEAR(psnr_srgb(image, constant(1, 1, 0.0f)), 4.771213, 1e-5);
}

TEST(Metrics, RelMseInBothConventions) {
  // The relative error is (2 - 1)^2 = 1 over 1^2 + lambda2.
  EXPECT_NEAR(relmse(constant(3, 3, 2), constant(3, 3, 1), kRelMseBcr), 0.5 / 1.01, 1e-9);
  EXPECT_NEAR(relmse(constant(3, 3, 2), constant(3, 3, 1), kRelMseGharbi), 1 / 1.0001, 1e-9);
  // A black reference leaves 0.5 * 0.25 / 0.01 and 0.25 / 1e-4.
  EXPECT_NEAR(relmse(constant(3, 3, 0.5f), constant(3, 3, 0)), 12.5, 1e-9);
  EXPECT_NEAR(relmse(constant(3, 3, 0.5f), constant(3, 3, 0), kRelMseGharbi), 2500, 1e-6);
}

TEST(Metrics, RelMseIsRelativeToTheReferenceAndNotToTheImage) {
  EXPECT_NEAR(relmse(constant(1, 1, 1), constant(1, 1, 3), {1, 1}), 4.0 / 10.0, 1e-12);
  EXPECT_NEAR(relmse(constant(1, 1, 3), constant(1, 1, 1), {1, 1}), 4.0 / 2.0, 1e-12);
}

TEST(Metrics, RelMseMapIsPerPixel) {
  Image image = constant(2, 1, 1);
  image.at(0, 0, 1) = 4;  // one channel of the right pixel: 9 / 2 / 3 channels
  const Image map = relmse_map(image, constant(2, 1, 1), {1, 1});
  ASSERT_EQ(map.channels, 1);
  EXPECT_FLOAT_EQ(map.at(0, 0, 0), 0);
  EXPECT_FLOAT_EQ(map.at(0, 0, 1), 1.5f);
}

TEST(Metrics, ANanShowsInRelMse) {
  Image image = constant(2, 2, 1);
  image.at(2, 1, 1) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(std::isnan(relmse(image, constant(2, 2, 1))));
}

TEST(Metrics, RefusesShapesThatDiffer) {
  EXPECT_ERROR(psnr_srgb(constant(4, 3, 0), constant(3, 4, 0)), "4 x 3", "3 x 4");
  EXPECT_ERROR(relmse(Image(2, 2, 1), constant(2, 2, 0)), "RGB");
  EXPECT_ERROR(relmse_map(constant(2, 2, 0), Image(2, 2, 6)), "RGB");
}

}  // namespace
}  // namespace raymeld
