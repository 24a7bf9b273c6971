#include "reference/reference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "support.h"
#include "within_bounds.h"

namespace raymeld::reference {
namespace {

using test::within_bounds;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr auto kFp32 = Precision::kFp32;
constexpr auto kFp16 = Precision::kFp16;

Planes row(std::vector<double> values) {
  const int w = int(values.size());
  return {1, 1, w, std::move(values)};
}

Conv single(double weight, double bias) {
  return {.out = 1, .in = 1, .kernel = 1, .weight = {weight}, .bias = {bias}};
}

TEST(Conv2d, OnesCountTheNeighbours) {
  const Conv ones{.out = 1, .in = 1, .kernel = 3, .weight = std::vector<double>(9, 1.0), .bias = {0.5}};
  const Planes y = conv2d(exact(Planes(1, 3, 3, std::vector<double>(9, 1.0))), ones, false, kFp32).value;
  EXPECT_EQ(y.data, (std::vector<double>{4.5, 6.5, 4.5, 6.5, 9.5, 6.5, 4.5, 6.5, 4.5}));
}

TEST(Conv2d, IsACorrelation) {
  Conv above{.out = 1, .in = 1, .kernel = 3, .weight = std::vector<double>(9), .bias = {0}};
  above.weight[0 * 3 + 1] = 1;  // ky 0 and kx 1 are the pixel above
  Conv right{.out = 1, .in = 1, .kernel = 3, .weight = std::vector<double>(9), .bias = {0}};
  right.weight[1 * 3 + 2] = 1;
  const Bounded x = exact(Planes(1, 2, 2, {1, 2, 3, 4}));
  EXPECT_EQ(conv2d(x, above, false, kFp32).value.data, (std::vector<double>{0, 0, 1, 2}));
  EXPECT_EQ(conv2d(x, right, false, kFp32).value.data, (std::vector<double>{2, 0, 4, 0}));
}

TEST(Conv2d, ChannelsAreOutThenIn) {
  const Conv conv{.out = 2, .in = 3, .kernel = 1, .weight = {1, 10, 100, 2, 20, 200}, .bias = {0, 1}};
  const Bounded y = conv2d(exact(Planes(3, 1, 2, {1, 2, 3, 4, 5, 6})), conv, false, kFp32);
  EXPECT_EQ(y.value.data, (std::vector<double>{531, 642, 1063, 1285}));
}

TEST(Conv2d, ReluComesBeforeTheResidual) {
  const Bounded x = exact(row({2, -3})), residual = exact(row({-10, 7}));
  EXPECT_EQ(conv2d(x, single(1, 0), true, kFp32).value.data, (std::vector<double>{2, 0}));
  EXPECT_EQ(conv2d(x, single(1, 0), true, kFp32, {&residual}).value.data, (std::vector<double>{-8, 7}));
  EXPECT_EQ(conv2d(x, single(1, 0), false, kFp32, {&residual}).value.data, (std::vector<double>{-8, 4}));
}

TEST(Conv2d, ResidualsAddUp) {
  Bounded a = exact(row({-10, 7})), b = exact(row({1, 1}));
  a.bound.data = {0.5, 0}, b.bound.data = {0.25, 0};
  const Bounded y = conv2d(exact(row({2, -3})), single(1, 0), true, kFp32, {&a, &b, &b});
  EXPECT_EQ(y.value.data, (std::vector<double>{-6, 9}));
  EXPECT_NEAR(y.bound.data[0], 1, 1e-5);
  EXPECT_GT(y.bound.data[0], 1 + std::ldexp(8 + 7 + 6, -24));  // each sum rounds once
}

TEST(Conv2d, ReluKeepsNaNAndMinusInfinity) {
  const Bounded y = conv2d(exact(row({std::nan(""), -kInfinity})), single(1, 0), true, kFp32);
  EXPECT_TRUE(std::isnan(y.value.data[0]));
  EXPECT_EQ(y.value.data[1], -kInfinity);
}

TEST(Conv2d, BoundIsTheStatedOne) {
  const double u = std::ldexp(1, -24);
  const auto gamma = [u](int n) { return n * u / (1 - n * u); };
  const auto flush = [](int n) { return n * std::ldexp(1, -126); };
  Bounded x = exact(row({-5}));
  const double s = 3 * 5 + 0.25;  // |w||x| + |b|
  EXPECT_DOUBLE_EQ(conv2d(x, single(3, 0.25), false, kFp32).bound.at(0, 0, 0), gamma(2) * s + flush(2));
  x.bound.at(0, 0, 0) = 0.1;
  const auto carried = [&](int n) { return 3 * 0.1 + gamma(n) * (s + 3 * 0.1) + flush(n); };
  EXPECT_DOUBLE_EQ(conv2d(x, single(3, 0.25), false, kFp32).bound.at(0, 0, 0), carried(2));
  // In 16 bits two more channels count.
  EXPECT_DOUBLE_EQ(conv2d(x, single(3, 0.25), false, kFp16).bound.at(0, 0, 0),
                   carried(4) + (14.75 + carried(4)) / 2048 + u);
}

TEST(Conv2d, ReluBoundEndsAtZero) {
  Bounded x = exact(row({-5, -1, 1}));
  for (double& bound : x.bound.data) bound = 2;
  const Bounded y = conv2d(x, single(1, 0), true, kFp32);
  EXPECT_EQ(y.bound.data[0], 0);
  EXPECT_NEAR(y.bound.data[1], 1, 1e-6);  // -1 + 2
  EXPECT_NEAR(y.bound.data[2], 2, 1e-6);
}

TEST(Conv2d, OverflowOfHalfHasNoBound) {
  EXPECT_EQ(conv2d(exact(row({300})), single(300, 0), false, kFp16).bound.at(0, 0, 0), kInfinity);
  EXPECT_LT(conv2d(exact(row({300})), single(300, 0), false, kFp32).bound.at(0, 0, 0), 1);
}

TEST(Conv2d, RefusesOtherShapes) {
  EXPECT_THROW(conv2d(exact(Planes(2, 1, 1)), single(1, 0), false, kFp32), std::invalid_argument);
  const Conv one_weight{.out = 1, .in = 1, .kernel = 3, .weight = {1}, .bias = {0}};
  EXPECT_THROW(conv2d(exact(row({1})), one_weight, false, kFp32), std::invalid_argument);
  const Bounded residual = exact(row({1, 2}));
  EXPECT_THROW(conv2d(exact(row({1})), single(1, 0), false, kFp32, {&residual}), std::invalid_argument);
}

// Computes as a device might: in fp32, with products summed backwards onto the bias, one column at a time.
Planes float_conv(const Planes& x, const Conv& conv, Precision store) {
  Planes y(conv.out, x.h, x.w);
  for (int column = 0; column < x.w; ++column) {
    for (int o = 0; o < conv.out; ++o) {
      for (int line = 0; line < x.h; ++line) {
        float sum = float(conv.bias[o]);
        for (int tap = conv.in * 9 - 1; tap >= 0; --tap) {
          const int i = tap / 9, yy = line + tap % 9 / 3 - 1, xx = column + tap % 3 - 1;
          if (yy < 0 || yy >= x.h || xx < 0 || xx >= x.w) continue;
          sum += float(conv.at(o, i, tap % 9 / 3, tap % 3)) * float(x.at(i, yy, xx));
        }
        y.at(o, line, column) = round_to(sum, store);
      }
    }
  }
  return y;
}

TEST(Conv2d, FloatArithmeticStaysWithinTheBound) {
  for (const Precision precision : {kFp32, kFp16}) {
    const Planes x = round_to(random_planes(16, 9, 11, Fill::kUniform, 1), precision);
    const Conv conv = test::round_to(random_conv(8, 16, 3, Fill::kUniform, 2), precision);
    EXPECT_TRUE(
        within_bounds("conv2d", float_conv(x, conv, precision), conv2d(exact(x), conv, false, precision)));
  }
}

TEST(Conv2d, OneWrongTapIsOutsideTheBound) {
  for (const Precision precision : {kFp32, kFp16}) {
    const Planes x = round_to(random_planes(16, 9, 11, Fill::kUniform, 1), precision);
    const Conv conv = test::round_to(random_conv(8, 16, 3, Fill::kUniform, 2), precision);
    Conv wrong = conv;
    std::swap(wrong.weight[40], wrong.weight[41]);
    EXPECT_FALSE(
        within_bounds("conv2d", float_conv(x, wrong, precision), conv2d(exact(x), conv, false, precision)));
  }
}

TEST(Conv2d, SmallIntegersAreExact) {
  const Planes x = random_planes(16, 9, 11, Fill::kIntegers, 3);
  const Conv conv = random_conv(8, 16, 3, Fill::kIntegers, 4);
  const Planes y = conv2d(exact(x), conv, false, kFp16).value;
  EXPECT_TRUE(within_bounds("conv2d", float_conv(x, conv, kFp16), exact(y)));
}

TEST(Concat, AppendsChannels) {
  const Bounded both = concat(exact(row({1, 2})), exact(Planes(2, 1, 2, {3, 4, 5, 6})));
  EXPECT_EQ(both.value.c, 3);
  EXPECT_EQ(both.value.data, (std::vector<double>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(both.bound.data.size(), 6u);
  EXPECT_THROW(concat(exact(row({1})), exact(row({1, 2}))), std::invalid_argument);
}

TEST(SpaceToDepth, PyTorchsChannelOrder) {
  const Bounded y =
      space_to_depth(exact(Planes(2, 2, 4, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15})), 2);
  EXPECT_EQ(y.value.c, 8);
  EXPECT_EQ(y.value.h, 1);
  EXPECT_EQ(y.value.w, 2);
  EXPECT_EQ(y.value.data, (std::vector<double>{0, 2, 1, 3, 4, 6, 5, 7, 8, 10, 9, 11, 12, 14, 13, 15}));
  const Planes row =
      space_to_depth(exact(Planes(1, 4, 4, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15})), 4).value;
  EXPECT_EQ(row.c, 16);
  EXPECT_EQ(row.data, (std::vector<double>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}));
  EXPECT_THROW(space_to_depth(exact(Planes(1, 3, 2)), 2), std::invalid_argument);
}

TEST(PixelShuffle, UndoesSpaceToDepth) {
  for (const int r : {2, 4, 8}) {
    const Bounded x = {random_planes(3, 3 * r, 5 * r, Fill::kUniform, 5),
                       random_planes(3, 3 * r, 5 * r, Fill::kUniform, 6)};
    const Bounded back = pixel_shuffle(space_to_depth(x, r), r);
    EXPECT_EQ(back.value.data, x.value.data);
    EXPECT_EQ(back.bound.data, x.bound.data);
  }
  EXPECT_EQ(pixel_shuffle(exact(Planes(4, 1, 1, {1, 2, 3, 4})), 2).value.data,
            (std::vector<double>{1, 2, 3, 4}));
  EXPECT_THROW(pixel_shuffle(exact(Planes(6, 1, 1)), 2), std::invalid_argument);
}

TEST(Encode, ClampsByKind) {
  const Planes image = row({std::nan(""), kInfinity, -kInfinity, -0.5, 0.5, 3, 200});
  const auto values = [&](LayerKind kind, Transfer transfer) {
    return encode(image, kind, transfer, 100, kFp32).value.data;
  };
  EXPECT_EQ(values(LayerKind::kRadiance, Transfer::kLinear),
            (std::vector<double>{0, 100, 0, 0, 0.5, 3, 100}));
  for (const Transfer transfer : {Transfer::kLinear, Transfer::kLog}) {
    EXPECT_EQ(values(LayerKind::kAlbedo, transfer), (std::vector<double>{0, 1, 0, 0, 0.5, 1, 1}));
    EXPECT_EQ(values(LayerKind::kNormal, transfer), (std::vector<double>{0, 1, -1, -0.5, 0.5, 1, 1}));
  }
}

TEST(Encode, LogCurve) {
  const Bounded y = encode(row({0, 0.125, 100, 1e9}), LayerKind::kRadiance, Transfer::kLog, 100, kFp32);
  EXPECT_DOUBLE_EQ(y.value.data[0], 0);
  EXPECT_DOUBLE_EQ(y.value.data[1], std::log(2.0) / 3);
  EXPECT_DOUBLE_EQ(y.value.data[2], std::log(801.0) / 3);
  EXPECT_DOUBLE_EQ(y.value.data[3], std::log(801.0) / 3);
  for (const double bound : y.bound.data) {
    EXPECT_GT(bound, std::ldexp(1, -21) / 3);
    EXPECT_LT(bound, 3e-6);
  }
}

TEST(Encode, OnlyTheLogAndTheHalfStoreRound) {
  const Planes image = row({0.1, 7});
  EXPECT_EQ(encode(image, LayerKind::kRadiance, Transfer::kLinear, 100, kFp32).bound.data,
            (std::vector<double>{0, 0}));
  EXPECT_DOUBLE_EQ(encode(image, LayerKind::kRadiance, Transfer::kLinear, 100, kFp16).bound.data[1],
                   7.0 / 2048 + std::ldexp(1, -24));
}

// A device may flush subnormals even where they are multiplied by 1.
TEST(Encode, SubnormalsMayBeFlushed) {
  const Planes image = row({0x1p-127, 0x1p-126, -0x1p-130});
  const auto bounds = [&](double exposure) {
    return encode(image, LayerKind::kRadiance, Transfer::kLinear, 100, kFp32, exposure).bound.data;
  };
  EXPECT_EQ(bounds(1), (std::vector<double>{0x1p-127, 0, 0}));
  EXPECT_GT(bounds(0x1p24)[0], 0x1p-103);
  EXPECT_LT(bounds(0x1p24)[1], 0x1p-120);
}

TEST(Encode, FloatLogStaysWithinTheBound) {
  Planes image = random_planes(3, 20, 50, Fill::kUniform, 7);
  for (double& v : image.data) v = float(100 * v * v * v * v * v);
  Planes actual = image;
  for (double& v : actual.data) v = std::log(1.0f + 8.0f * std::max(float(v), 0.0f)) * (1.0f / 3.0f);
  EXPECT_TRUE(
      within_bounds("encode", actual, encode(image, LayerKind::kRadiance, Transfer::kLog, 100, kFp32)));
}

TEST(Bilinear, PhaseZeroStartsOnTheSample) {
  const Planes y = bilinear(exact(row({10, 20})), 2, 0).value;
  EXPECT_EQ(y.h, 2);
  EXPECT_EQ(y.data, (std::vector<double>{10, 15, 20, 20, 10, 15, 20, 20}));
}

TEST(Bilinear, HalfACellOffForARealRender) {
  const Planes y = bilinear(exact(Planes(1, 2, 1, {10, 20})), 4, 1.5).value;
  EXPECT_EQ(y.w, 4);
  const std::vector<double> column = {10, 10, 11.25, 13.75, 16.25, 18.75, 20, 20};
  for (int i = 0; i < y.h; ++i) {
    for (int x = 0; x < y.w; ++x) EXPECT_EQ(y.at(0, i, x), column[size_t(i)]) << i;
  }
}

TEST(Bilinear, MixesFourAndCarriesTheirBounds) {
  Bounded x = exact(Planes(1, 2, 2, {0, 4, 8, 100}));
  for (double& bound : x.bound.data) bound = 0.5;
  const Bounded y = bilinear(x, 2, 0);
  EXPECT_EQ(y.value.at(0, 1, 1), 28);
  EXPECT_NEAR(y.bound.at(0, 1, 1), 0.5, 1e-4);
  EXPECT_GT(y.bound.at(0, 1, 1), 0.5);
}

TEST(Decode, UndoesEncode) {
  const Planes image = row({0, 1e-6, 0.18, 1, 42, 100});
  const Bounded encoded = exact(encode(image, LayerKind::kRadiance, Transfer::kLog, 100, kFp32).value);
  const Bounded decoded = decode(encoded, nullptr, Transfer::kLog, kFp32);
  for (size_t i = 0; i < image.data.size(); ++i) {
    EXPECT_NEAR(decoded.value.data[i], image.data[i], 1e-12);
    EXPECT_GT(decoded.bound.data[i], 0);
    EXPECT_LT(decoded.bound.data[i], 1e-6 + 3e-6 * image.data[i]);
  }
}

TEST(Decode, AddsTheBaseAndClamps) {
  const Bounded rec = exact(row({1, -2, 70000})), base = exact(row({0.5, 1, 0}));
  const Bounded linear = decode(rec, &base, Transfer::kLinear, kFp32);
  EXPECT_EQ(linear.value.data, (std::vector<double>{1.5, 0, 65504}));
  EXPECT_EQ(linear.bound.data[1], 0);
  EXPECT_EQ(linear.bound.data[2], 0);
  const Bounded log = decode(rec, &base, Transfer::kLog, kFp32);
  EXPECT_DOUBLE_EQ(log.value.data[0], (std::exp(4.5) - 1) / 8);
  EXPECT_EQ(log.value.data[1], 0);
  EXPECT_EQ(log.value.data[2], 65504);
  EXPECT_EQ(log.bound.data[2], 0);
}

TEST(Decode, FloatExpStaysWithinTheBound) {
  const Planes rec = test::planes(1, 40, 50, test::floats(random_planes(1, 40, 50, Fill::kUniform, 8)));
  const Bounded base = exact(random_planes(1, 40, 50, Fill::kUniform, 9));
  Planes actual = rec;
  for (size_t i = 0; i < rec.data.size(); ++i) {
    const float y = float(rec.data[i]) + float(base.value.data[i]);
    actual.data[i] = std::clamp((std::exp(3 * y) - 1) * 0.125f, 0.0f, 65504.0f);
  }
  EXPECT_TRUE(within_bounds("decode", actual, decode(exact(rec), &base, Transfer::kLog, kFp32)));
}

// An error of the input moves the output by no more than the output's bound, at the clamp's edges too.
TEST(Decode, CarriesTheInputsBound) {
  for (const Transfer transfer : {Transfer::kLinear, Transfer::kLog}) {
    for (const double y : {-0.3, -0.1, 0.0, 0.1, 2.0, 4.39, 4.5, 300.0}) {
      Bounded rec = exact(row({y, y}));
      for (double& bound : rec.bound.data) bound = 0.2;
      const Planes moved = decode(exact(row({y - 0.1999, y + 0.1999})), nullptr, transfer, kFp32).value;
      EXPECT_TRUE(within_bounds("decode", moved, decode(rec, nullptr, transfer, kFp32))) << "y = " << y;
    }
  }
}

}  // namespace
}  // namespace raymeld::reference
