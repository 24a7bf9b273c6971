// Tests the reference's own F(2, 3) and F(4, 3), its computation in floats, and the bound of tensor cores.
#include <gtest/gtest.h>

#include <cmath>
#include <span>

#include "reference/winograd.h"
#include "support.h"

namespace raymeld::reference {
namespace {

struct Trial {
  int kernel = 3;
  Conv conv = random_conv(3, 4, kernel, Fill::kUniform, 1);
  Planes x = random_planes(4, 9, 7, Fill::kUniform, 2);
  Planes direct = conv2d(exact(x), without_bias(conv), false, Precision::kFp32).value;

  static Conv without_bias(Conv conv) {
    std::ranges::fill(conv.bias, 0.0);
    return conv;
  }
};

double largest_difference(const Planes& a, const Planes& b) {
  double largest = 0;
  for (size_t i = 0; i < a.data.size(); ++i) largest = std::max(largest, std::abs(a.data[i] - b.data[i]));
  return largest;
}

// Lists direct sums, and then tiles in the order in which their errors grow.
constexpr Tile kAll[] = {{1, 1}, {2, 1}, {2, 2}, {4, 1}, {4, 4}};
constexpr std::span kTiles = std::span(kAll).subspan(1);

// Kernels in one direction compute no 5x5.
class Winograd : public testing::TestWithParam<int> {
 protected:
  std::vector<Tile> tiles() const {
    if (GetParam() == 5) return {{2, 2}, {4, 4}};
    return {kTiles.begin(), kTiles.end()};
  }
  const Trial trial_{.kernel = GetParam()};
};

TEST_P(Winograd, IsTheConvolution) {
  for (const Tile& tile : tiles())
    EXPECT_LT(largest_difference(winograd(trial_.x, trial_.conv, tile), trial_.direct),
              GetParam() == 5 ? 1e-13 : 1e-14);
}

// Winograd in floats errs by more with larger tiles, and stays within the bound of its transforms'
// magnitudes.
TEST_P(Winograd, InFloatsErrsWithinItsBound) {
  double before = 1e-8;
  for (const Tile& tile : tiles()) {
    const Planes rounded = winograd_in_floats(trial_.x, trial_.conv, tile);
    const double error = largest_difference(rounded, trial_.direct);
    EXPECT_GT(error, before);
    EXPECT_LT(error, 1e-5);
    before = error;
    const Planes magnitudes = winograd_magnitudes(exact(trial_.x), trial_.conv, tile);
    for (size_t i = 0; i < rounded.data.size(); ++i)
      EXPECT_LE(std::abs(rounded.data[i] - trial_.direct.data[i]),
                gamma(winograd_roundings(trial_.conv, tile)) * magnitudes.data[i]);
  }
}

INSTANTIATE_TEST_SUITE_P(Kernels, Winograd, testing::Values(3, 5), testing::PrintToStringParamName());

TEST(InFloats, AConvolutionKeepsItsBoundAndRounds) {
  const Planes x = round_to(random_planes(4, 9, 7, Fill::kUniform, 2), Precision::kFp16);
  const Planes residual = round_to(random_planes(3, 9, 7, Fill::kUniform, 3), Precision::kFp16);
  const Conv conv = round_to(random_conv(3, 4, 3, Fill::kUniform, 1), Precision::kFp16);
  const Bounded added = exact(residual);
  for (const Precision precision : {Precision::kFp32, Precision::kFp16}) {
    for (const Tile& tile : kAll) {
      const Bounded truth = conv2d(exact(x), conv, true, precision, {&added}, tile);
      const Planes floats = conv2d_in_floats(x, conv, true, precision, {&residual}, tile);
      EXPECT_LE(worst(floats, truth).ratio, 1);
      EXPECT_GT(largest_difference(floats, truth.value), 0);
      for (const double v : floats.data) EXPECT_EQ(v, round_to(v, precision));
    }
  }
}

// Small whole numbers leave nothing to round.
TEST(InFloats, WholeNumbersAreExact) {
  const Planes x = random_planes(4, 9, 7, Fill::kSigns, 2);
  Conv conv = random_conv(3, 4, 3, Fill::kSigns, 1);
  for (double& w : conv.weight) w *= 576;
  for (const Tile& tile : kAll) {
    EXPECT_EQ(conv2d_in_floats(x, conv, false, Precision::kFp32, {}, tile).data,
              conv2d(exact(x), conv, false, Precision::kFp32).value.data);
  }
}

TEST(AllowedRms, IsAFewTimesThatOfFloatsAndARounding) {
  const Planes truth(1, 1, 4, {1, -8, 3, 2}), floats(1, 1, 4, {1, -8, 3, 2 + 0x1p-13});
  EXPECT_EQ(rms_of_difference(floats, truth), 0x1p-14);
  EXPECT_EQ(allowed_rms(truth, floats, Precision::kFp32), kRmsFactor * 0x1p-14 + 8 * kUnit);
  EXPECT_EQ(allowed_rms(truth, truth, Precision::kFp16), 8 * kHalfUnit);
}

TEST(RmsOfDifference, LeavesOutTheLargestHundredth) {
  const Planes zeros(1, 20, 10);
  Planes errors = zeros;
  for (double& error : errors.data) error = -2;
  errors.at(0, 3, 7) = 1000, errors.at(0, 19, 9) = NAN;
  EXPECT_EQ(rms_of_difference(errors, zeros), 2);
  errors.at(0, 0, 0) = 200;
  EXPECT_GT(rms_of_difference(errors, zeros), 14);
}

double truncated(double value, int exponent) {
  const double step = std::ldexp(1, exponent - 23);
  return std::trunc(value / step) * step;
}

// Returns the sum of a tensor core that truncates wherever it may.
double truncating_sum(double sum, const std::vector<double>& products, size_t block) {
  for (size_t first = 0; first < products.size(); first += block) {
    int exponent = std::ilogb(sum);
    for (size_t i = first; i < first + block; ++i) exponent = std::max(exponent, std::ilogb(products[i]));
    double step = truncated(sum, exponent);
    for (size_t i = first; i < first + block; ++i) step += truncated(products[i], exponent);
    sum = truncated(step, std::ilogb(step));
  }
  return sum;
}

// Truncation drops every one of these products, so it errs by more than roundings to nearest could.
TEST(TensorUnits, HoldForACoreThatTruncatesAndAreNoneTooMany) {
  constexpr int kProducts = 576;
  const std::vector<double> products(kProducts, 2 * kUnit * (1 - 0x1p-10));
  const double truth = 1 + kProducts * products[0];
  for (const size_t block : {2, 4, 8, 16}) {
    const double error = std::abs(truncating_sum(1, products, block) - truth);
    EXPECT_LE(error, gamma(kTensorUnits * (kProducts + 1)) * truth) << block;
    EXPECT_GT(error, gamma(kTensorUnits * (kProducts + 1)) * truth / 2.1) << block;
    EXPECT_GT(error, gamma(kProducts + 1) * truth) << block;
  }
}

}  // namespace
}  // namespace raymeld::reference
