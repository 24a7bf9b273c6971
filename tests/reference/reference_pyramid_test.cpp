#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "expect_near.h"
#include "reference/reference.h"

namespace raymeld::reference {
namespace {

using test::expect_near;

constexpr auto kFp32 = Precision::kFp32;
constexpr auto kLog = Transfer::kLog, kLinear = Transfer::kLinear;

double light_of(double x) { return std::log(1 + 0.2 * x) / 0.2; }

// Returns one pixel of three equal channels.
Planes gray(double value) { return Planes(3, 1, 1, {value, value, value}); }

TEST(Light, IsDemodulatedAndCompressed) {
  std::vector<double> color, albedo, expected;
  for (const auto& [radiance, surface] : {std::pair(2.0, 0.6), {3, 0.1}, {4, 1}}) {
    color.insert(color.end(), 4, radiance);
    albedo.insert(albedo.end(), 4, surface);
    expected.insert(expected.end(), 4, light_of(radiance / (surface + 0.4)));
  }
  expect_near(light(exact(Planes(3, 2, 2, color)), exact(Planes(3, 2, 2, albedo)), kLinear, kFp32), expected);
}

// The only neighbour of a pixel is its brightest one, so the second brightest is black.
TEST(Light, DarkensFireflies) {
  const Planes color(3, 1, 2, {5, 0, 5, 0, 5, 0}), albedo(3, 1, 2, std::vector(6, 0.6));
  const double dimmed = light_of(1e-3);
  expect_near(light(exact(color), exact(albedo), kLinear, kFp32), {dimmed, 0, dimmed, 0, dimmed, 0});
}

TEST(Light, LimitsFirefliesByTheSecondBrightestNeighbour) {
  const auto limited = [](const Planes& color, int y, int x) {
    Planes albedo(3, 4, 4);
    for (double& surface : albedo.data) surface = 0.6;
    const Planes result = light(exact(color), exact(albedo), kLinear, kFp32).value;
    return std::array{result.at(0, y, x), result.at(1, y, x)};
  };
  Planes color(3, 4, 4);
  for (double& radiance : color.data) radiance = 0.5;
  for (const int c : {0, 1, 2}) color.at(c, 1, 1) = 40;
  EXPECT_NEAR(limited(color, 1, 1)[0], light_of(20 * 0.5 + 1e-3), 1e-9);
  // One bright neighbour may be another firefly, but two are a lamp.
  for (const int c : {0, 1, 2}) color.at(c, 1, 2) = 30;
  EXPECT_NEAR(limited(color, 1, 1)[0], light_of(20 * 0.5 + 1e-3), 1e-9);
  for (const int c : {0, 1, 2}) color.at(c, 2, 2) = 3;
  EXPECT_NEAR(limited(color, 1, 1)[0], light_of(40), 1e-9);
  // The ratio of the channels is kept, and pixels outside the image count as black.
  Planes corner(3, 4, 4);
  corner.at(0, 3, 3) = 10, corner.at(1, 3, 3) = 5;
  const double factor = 1e-3 / (0.2126 * 10 + 0.7152 * 5);
  EXPECT_NEAR(limited(corner, 3, 3)[0], light_of(factor * 10), 1e-9);
  EXPECT_NEAR(limited(corner, 3, 3)[1], light_of(factor * 5), 1e-9);
}

// The first pixel of each cell is the mean of both renders.
TEST(Light, HasASampleOfLrhsWhereItWasRendered) {
  for (const Transfer transfer : {kLinear, kLog}) {
    const auto encoded = [&](double x) { return transfer == kLog ? std::log(1 + 8 * x) / 3 : x; };
    const std::vector<double> ones(24, encoded(1)), samples{encoded(5), encoded(2)};
    std::vector<double> surfaces, low, expected;
    for (int c = 0; c < 3; ++c) {
      surfaces.insert(surfaces.end(), {0.6, 0.6, 0.1, 0.6, 0.6, 0.6, 0.6, 0.6});
      low.insert(low.end(), samples.begin(), samples.end());
      const double other = light_of(1);
      expected.insert(expected.end(), {light_of((1 + 3 * 5) / 4.0), other, light_of((1 + 3 * 2) / 4.0 / 0.5),
                                       other, other, other, other, other});
    }
    const Bounded lrhs = exact(Planes(3, 1, 2, low));
    expect_near(light(exact(Planes(3, 2, 4, ones)), exact(Planes(3, 2, 4, surfaces)), transfer, kFp32,
                      Decimated{lrhs, 2, 3}),
                expected);
  }
}

TEST(CellLight, HasTheMeanAlbedoOfTheCell) {
  const Planes albedo(3, 2, 2, {1, 0, 0, 1, 0.6, 0.6, 0.6, 0.6, 0, 0, 0, 0});
  const double encoded = std::log(1 + 8 * 3.0) / 3;
  expect_near(cell_light(exact(gray(encoded)), exact(albedo), kLog, 2, 0.5, kFp32),
              {light_of(3 / 0.9), light_of(3), light_of(3 / 0.4)});
}

TEST(CellLight, HasTheAlbedoOfThePixelThatWasRendered) {
  const Planes albedo(3, 2, 2, {1, 0, 0, 0, 0.6, 0, 1, 1, 0, 1, 1, 1});
  const double encoded = std::log(1 + 8 * 3.0) / 3;
  expect_near(cell_light(exact(gray(encoded)), exact(albedo), kLog, 2, 0, kFp32),
              {light_of(3 / 1.4), light_of(3), light_of(3 / 0.4)});
}

TEST(Pool, IsTheMeanOfFourAndMovesToAnother) {
  Planes image(10, 2, 2);
  for (int c = 0; c < 10; ++c) image.at(c, 0, 1) = image.at(c, 1, 0) = 2 * c;
  const Bounded x = exact(image), other = exact(gray(9));
  expect_near(pool(x, kFp32), {0, 1, 2, 4, 5, 6, 7, 8, 9});
  expect_near(pool(x, kFp32, &other, 0.25), {2.25, 3, 3.75, 4, 5, 6, 7, 8, 9});
  expect_near(pool(x, kFp32, &other, 1), {9, 9, 9, 4, 5, 6, 7, 8, 9});
}

TEST(KernelFilter, WeighsNeighboursByTheSoftmax) {
  Planes x(3, 1, 3, {1, 2, 4, 10, 20, 40, 0, 0, 0}), logits(9, 1, 3);
  for (double& logit : logits.data) logit = -1e3;
  logits.at(4, 0, 0) = 7;                                      // the pixel itself
  logits.at(3, 0, 1) = std::log(3.0), logits.at(5, 0, 1) = 0;  // left and right
  logits.at(8, 0, 2) = logits.at(4, 0, 2) = 2;  // below and right is the pixel itself, replicated
  expect_near(kernel_filter(exact(x), exact(logits), 3, kFp32), {1, 1.75, 4, 10, 17.5, 40, 0, 0, 0});
}

TEST(KernelFilter, IsBlendedWithTheCoarserImage) {
  const Bounded x = exact(Planes(3, 2, 2, std::vector(12, 1.0))), coarse = exact(gray(5));
  Planes logits(2, 2, 2);
  logits.at(1, 0, 0) = 100, logits.at(1, 0, 1) = -100, logits.at(1, 1, 0) = std::log(3.0);
  const Bounded result = kernel_filter(x, exact(logits), 1, kFp32, &coarse);
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(result.value.at(c, 0, 0), 5, 1e-12);
    EXPECT_NEAR(result.value.at(c, 0, 1), 1, 1e-12);
    EXPECT_NEAR(result.value.at(c, 1, 0), 4, 1e-12);
    EXPECT_NEAR(result.value.at(c, 1, 1), 3, 1e-12);
  }
}

TEST(KernelFilter, CountsWhatIsAlike) {
  const Bounded x = exact(Planes(3, 1, 2, {1, 5, 1, 5, 1, 5}));
  Planes logits(11, 1, 2), guides(6, 1, 2);
  guides.at(1, 0, 1) = 0.2, guides.at(5, 0, 1) = 0.4;
  logits.at(9, 0, 0) = std::log(2.0), logits.at(10, 0, 0) = std::log(3.0);
  // The other pixel is three of the nine taps. It differs by 6.25 * 2 * 0.04 + 2.25 * 3 * 0.16 from the
  // first.
  const double alike = std::exp(-(0.5 + 1.08)), other = std::exp(-(0.25 + 0.36));
  const Bounded guide = exact(guides);
  const Bounded y = kernel_filter(x, exact(logits), 3, kFp32, nullptr, &guide);
  EXPECT_NEAR(y.value.at(0, 0, 0), (6 + 3 * alike * 5) / (6 + 3 * alike), 1e-12);
  EXPECT_NEAR(y.value.at(2, 0, 1), (6 * 5 + 3 * other) / (6 + 3 * other), 1e-12);
}

// A kernel that prefers no pixel leaves an even albedo as it is.
TEST(Compose, MixesRemodulatedLightAndLrhs) {
  Planes rec(15, 1, 1), guides(6, 1, 1);
  for (int c = 0; c < 3; ++c) guides.at(c, 0, 0) = 0.6;
  rec.at(0, 0, 0) = 0.5, rec.at(3, 0, 0) = std::log(3.0);
  const double x = 2, surface = 0.6 + 0.4, low = 10;
  const auto lrhs = exact(gray(low)), light = exact(gray(light_of(x))), surfaces = exact(guides);
  const double mixed = low + 0.75 * (x * surface - low);
  expect_near(compose(exact(rec), light, surfaces, lrhs, kLinear, 1, 0, kFp32), {mixed + 0.5, mixed, mixed});
  const double encoded = low + 0.75 * (std::log(1 + 8 * x * surface) / 3 - low);
  expect_near(compose(exact(rec), light, surfaces, lrhs, kLog, 1, 0, kFp32),
              {encoded + 0.5, encoded, encoded});
}

TEST(PyramidLayers, RefuseOtherShapes) {
  const Bounded one = exact(gray(1)), two = exact(Planes(3, 2, 2));
  EXPECT_THROW(light(one, two, kLog, kFp32), std::invalid_argument);
  EXPECT_THROW(light(two, two, kLog, kFp32, Decimated{two, 2, 1}), std::invalid_argument);
  EXPECT_THROW(cell_light(one, two, kLog, 4, 1.5, kFp32), std::invalid_argument);
  EXPECT_THROW(pool(two, kFp32), std::invalid_argument);
  EXPECT_THROW(kernel_filter(one, one, 3, kFp32), std::invalid_argument);
  EXPECT_THROW(compose(one, one, one, one, kLog, 1, 0, kFp32), std::invalid_argument);
}

}  // namespace
}  // namespace raymeld::reference
