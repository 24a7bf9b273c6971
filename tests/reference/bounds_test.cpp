#include "reference/bounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>

#include "within_bounds.h"

namespace raymeld::reference {
namespace {

using test::within_bounds;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Decodes a finite IEEE 754 binary16 from its bits, by definition.
double half_from_bits(uint32_t bits) {
  const double sign = bits & 0x8000 ? -1 : 1;
  const int exponent = int(bits >> 10 & 31), fraction = int(bits & 1023);
  return exponent == 0 ? sign * fraction * 0x1p-24 : sign * std::ldexp(1024 + fraction, exponent - 25);
}

TEST(RoundToHalf, EveryHalfStays) {
  for (uint32_t bits = 0; bits < 0x7c00; ++bits) {
    EXPECT_EQ(round_to_half(half_from_bits(bits)), half_from_bits(bits));
    EXPECT_EQ(round_to_half(half_from_bits(bits | 0x8000)), half_from_bits(bits | 0x8000));
  }
}

TEST(RoundToHalf, NearestAndTiesToEven) {
  for (uint32_t bits = 0; bits < 0x7bff; ++bits) {
    const double low = half_from_bits(bits), high = half_from_bits(bits + 1), middle = (low + high) / 2;
    ASSERT_EQ(round_to_half(middle), bits % 2 == 0 ? low : high) << "between " << low << " and " << high;
    ASSERT_EQ(round_to_half(std::nextafter(middle, 0)), low);
    ASSERT_EQ(round_to_half(std::nextafter(middle, kInfinity)), high);
    ASSERT_EQ(round_to_half(-middle), -round_to_half(middle));
  }
}

TEST(RoundToHalf, Limits) {
  EXPECT_EQ(round_to_half(std::nextafter(65520, 0)), 65504);
  EXPECT_EQ(round_to_half(65520), kInfinity);
  EXPECT_EQ(round_to_half(-1e30), -kInfinity);
  EXPECT_EQ(round_to_half(kInfinity), kInfinity);
  EXPECT_TRUE(std::isnan(round_to_half(std::nan(""))));
  EXPECT_TRUE(std::signbit(round_to_half(-0.0)));
  EXPECT_EQ(round_to_half(5e-324), 0);
}

TEST(StoredBound, AddsTheRoundingOfTheStore) {
  EXPECT_EQ(stored_bound(3, 0.5, Precision::kFp32), 0.5);
  EXPECT_EQ(stored_bound(3, 0.5, Precision::kFp16), 0.5 + 3.5 / 2048 + std::ldexp(1, -24));
  EXPECT_EQ(stored_bound(0, 0, Precision::kFp16), 0);
}

TEST(StoredBound, OverflowIsNeverBounded) {
  EXPECT_EQ(stored_bound(65000, 600, Precision::kFp16), kInfinity);
  EXPECT_LT(stored_bound(65000, 400, Precision::kFp16), 450);
  EXPECT_EQ(stored_bound(-3.5e38, 0, Precision::kFp32), kInfinity);
}

TEST(Worst, NamesTheWorstPlace) {
  Bounded expected = exact(Planes(2, 3, 4));
  for (double& bound : expected.bound.data) bound = 0.5;
  Planes actual(2, 3, 4);
  actual.at(0, 1, 1) = 0.4;
  actual.at(1, 2, 3) = -1;
  actual.at(1, 0, 0) = 0.6;
  const Worst at = worst(actual, expected);
  EXPECT_DOUBLE_EQ(at.ratio, 2);
  EXPECT_EQ(at.c, 1);
  EXPECT_EQ(at.y, 2);
  EXPECT_EQ(at.x, 3);
  EXPECT_EQ(at.actual, -1);
  EXPECT_EQ(at.failures, 2u);
  const testing::AssertionResult result = within_bounds("fuse", actual, expected);
  EXPECT_FALSE(result);
  EXPECT_NE(std::string(result.message()).find("fuse (2 x 3 x 4): worst error / bound 2 at c 1, y 2, x 3"),
            std::string::npos)
      << result.message();
}

TEST(Worst, WithoutABoundOnlyTheSameValuePasses) {
  const Bounded expected = exact(Planes(1, 1, 2, {1, -0.0}));
  EXPECT_TRUE(within_bounds("same", Planes(1, 1, 2, {1, 0.0}), expected));
  EXPECT_EQ(worst(Planes(1, 1, 2, {1, 5e-324}), expected).ratio, kInfinity);
}

TEST(Worst, SpecialValues) {
  const double nan = std::nan("");
  const auto ratio = [](double actual, double expected, double bound) {
    return worst(Planes(1, 1, 1, {actual}), {Planes(1, 1, 1, {expected}), Planes(1, 1, 1, {bound})}).ratio;
  };
  EXPECT_EQ(ratio(nan, 1, 100), kInfinity);
  EXPECT_EQ(ratio(1, nan, 100), kInfinity);
  EXPECT_EQ(ratio(nan, nan, 0), 0);
  EXPECT_EQ(ratio(kInfinity, 1, 100), kInfinity);
  EXPECT_EQ(ratio(kInfinity, kInfinity, 0), 0);
  EXPECT_EQ(ratio(-kInfinity, kInfinity, 100), kInfinity);
  EXPECT_EQ(ratio(1, 2, kInfinity), kInfinity);
  EXPECT_EQ(ratio(1, 2, nan), kInfinity);
}

TEST(Worst, RefusesOtherShapes) {
  EXPECT_THROW(worst(Planes(1, 2, 3), exact(Planes(1, 3, 2))), std::invalid_argument);
  EXPECT_THROW(Planes(1, 2, 3, {1, 2}), std::invalid_argument);
}

}  // namespace
}  // namespace raymeld::reference
