#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "expect_near.h"
#include "reference/reference.h"
#include "support.h"
#include "within_bounds.h"

namespace raymeld::reference {
namespace {

using test::expect_near;
using test::within_bounds;

constexpr auto kFp32 = Precision::kFp32;
constexpr auto kLog = Transfer::kLog, kLinear = Transfer::kLinear;

Planes uniform(int c, int h, int w, double value) {
  Planes image(c, h, w);
  std::ranges::fill(image.data, value);
  return image;
}

// Returns values in [low, high], rounded to floats.
Planes random(int c, int h, int w, double low, double high, uint64_t seed) {
  Planes image = random_planes(c, h, w, Fill::kUniform, seed);
  for (double& v : image.data) v = float(low + (high - low) * (0.5 + v / 2));
  return image;
}

double encoded(double x) { return std::log(1 + 8 * x) / 3; }

// Returns normals so far apart, 60 widths, that no neighbour counts.
Planes apart(int h, int w, int scale) {
  Planes normal(3, scale * h, scale * w);
  for (int y = 0; y < normal.h; ++y) {
    for (int x = 0; x < normal.w; ++x) normal.at(0, y, x) = 72 * (x / scale + 3 * (y / scale));
  }
  return normal;
}

TEST(Irradiance, DividesByTheAlbedoOfTheCorner) {
  Planes albedo(3, 2, 4);
  albedo.at(0, 0, 0) = 0.6, albedo.at(0, 0, 2) = 0.1, albedo.at(1, 0, 0) = 1;
  const Planes lrhs(3, 1, 2, {2, 3, 7, 1, 0, 8});
  const Planes y = irradiance(exact(lrhs), exact(albedo), exact(apart(1, 2, 2)), kLinear, 2, 0, kFp32).value;
  expect_near(y, {2 / 1.0, 3 / 0.5, 7 / 1.4, 1 / 0.4, 0, 8 / 0.4});
}

TEST(Irradiance, DividesCenteredSamplesByTheMeanAlbedo) {
  Planes albedo(3, 2, 2);
  albedo.at(0, 0, 0) = 1, albedo.at(0, 1, 1) = 0.4;
  const Planes lrhs(3, 1, 1, {encoded(3), encoded(1), 0});
  const Planes y = irradiance(exact(lrhs), exact(albedo), exact(Planes(3, 2, 2)), kLog, 2, 0.5, kFp32).value;
  expect_near(y, {encoded(3 / 0.75), encoded(1 / 0.4), 0});
}

TEST(Irradiance, IsTheMeanOfLikeNeighbours) {
  const Planes lrhs(3, 1, 3, {0.4, 0.8, 1.6, 0, 0, 0, 0, 0, 0});
  // The third block's normal differs by 0.6 at its corner, and by a quarter of that on average.
  Planes normal(3, 2, 6);
  normal.at(1, 0, 4) = 0.6;
  const double like = std::exp(-0.25), hardly = std::exp(-1.0 / 64);
  const auto expected = [](double weight) {
    return std::vector<double>{(3 * 1 + 2) / 4.0, (1 + 2 * 2 + weight * 4) / (3 + weight),
                               (weight * 2 + 3 * 4) / (weight + 3)};
  };
  for (const double phase : {0.0, 0.5}) {
    const Planes y =
        irradiance(exact(lrhs), exact(Planes(3, 2, 6)), exact(normal), kLinear, 2, phase, kFp32).value;
    expect_near(slice(exact(y), 0, 1).value, expected(phase > 0 ? hardly : like));
  }
}

// Demodulates the color with one pixel of LRHS: `lrhs` is its color and irradiance, and its certainty is 3.
Planes demodulated(const Planes& color, const Planes& albedo, const std::vector<double>& lrhs, double phase,
                   Transfer transfer) {
  return demodulate(exact(color), exact(albedo), exact(Planes(6, 1, 1, lrhs)), 3, transfer, 2, phase, kFp32)
      .value;
}

double compressed(double x) { return std::log(1 + 0.2 * x) / 0.2; }

TEST(Demodulate, LrhsCountsAtItsPixelByItsCertainty) {
  Planes albedo = uniform(3, 2, 2, 0.6);
  albedo.at(1, 0, 0) = 0.1;
  const Planes y =
      demodulated(uniform(3, 2, 2, encoded(1)), albedo, {encoded(3), encoded(2), 0, 1, 2, 3}, 0, kLog);
  const double one = compressed(1), brightness = 0.2126 + 2 * 0.7152 + 3 * 0.0722;
  expect_near(y, {compressed((1 + 3 * 3) / 4.0),
                  one,
                  one,
                  one,
                  compressed((1 + 3 * 2) / (4 * 0.5)),
                  one,
                  one,
                  one,
                  compressed(1 / 4.0),
                  one,
                  one,
                  one,
                  4,
                  1,
                  1,
                  1,
                  brightness,
                  brightness,
                  brightness,
                  brightness});
}

TEST(Demodulate, CenteredLrhsCountsInAllPixelsThatItCovers) {
  const Planes y =
      demodulated(uniform(3, 2, 2, 1), uniform(3, 2, 2, 0.1), {50, 60, 70, 1, 2, 3}, 0.5, kLinear);
  const double counts = 3.0 / 4;
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(y.at(c, 1, 0), compressed((2 + counts * (c + 1)) / (1 + counts)), 1e-12);
  }
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(y.data[size_t(3 * 4 + i)], 1 + counts, 1e-12);
}

TEST(Demodulate, FirefliesAreLimitedByTheSecondBrightestNeighbour) {
  const auto limited = [](const Planes& color, int y, int x) {
    const Bounded black = exact(Planes(6, 2, 2));
    const Planes albedo = uniform(3, 4, 4, 0.6);
    const Planes result = demodulate(exact(color), exact(albedo), black, 0, kLinear, 2, 0, kFp32).value;
    return std::array{result.at(0, y, x), result.at(1, y, x)};
  };
  Planes color = uniform(3, 4, 4, 0.5);
  for (int c : {0, 1, 2}) color.at(c, 1, 1) = 40;
  EXPECT_NEAR(limited(color, 1, 1)[0], compressed(20 * 0.5 + 1e-3), 1e-9);
  // One bright neighbour may be another firefly, but two are a lamp.
  for (int c : {0, 1, 2}) color.at(c, 1, 2) = 30;
  EXPECT_NEAR(limited(color, 1, 1)[0], compressed(20 * 0.5 + 1e-3), 1e-9);
  for (int c : {0, 1, 2}) color.at(c, 2, 2) = 3;
  EXPECT_NEAR(limited(color, 1, 1)[0], compressed(40), 1e-9);
  // The ratio of the channels is kept, and pixels outside the image count as black.
  Planes corner(3, 4, 4);
  corner.at(0, 3, 3) = 10, corner.at(1, 3, 3) = 5;
  const double factor = 1e-3 / (0.2126 * 10 + 0.7152 * 5);
  EXPECT_NEAR(limited(corner, 3, 3)[0], compressed(factor * 10), 1e-9);
  EXPECT_NEAR(limited(corner, 3, 3)[1], compressed(factor * 5), 1e-9);
}

TEST(Demodulate, BrightnessIsUpsampledWithThePhase) {
  Planes lrhs(6, 1, 2);
  lrhs.at(4, 0, 1) = 1 / 0.7152;
  const Bounded dark = exact(Planes(3, 2, 4));
  const auto brightness = [&](double phase) {
    return slice(demodulate(dark, dark, exact(lrhs), 1, kLinear, 2, phase, kFp32), 4, 1).value;
  };
  expect_near(brightness(0), {0, 0.5, 1, 1, 0, 0.5, 1, 1});
  expect_near(brightness(0.5), {0, 0.25, 0.75, 1, 0, 0.25, 0.75, 1});
}

struct Guides {
  Bounded albedo, normal, brightness;
};

Guides flat(int h, int w) {
  return {exact(uniform(3, h, w, 0.5)), exact(uniform(3, h, w, -0.25)), exact(uniform(1, h, w, 2))};
}

// An image of three channels gets the same certainty everywhere.
Bounded filtered(const Planes& x, const Guides& guides, int step, Precision precision = kFp32,
                 const GuideFactors& factors = {1, 1, 1}) {
  const Bounded certain = x.c == 4 ? exact(x) : concat(exact(x), exact(uniform(1, x.h, x.w, 2)));
  const Bounded y =
      joint_filter(certain, guides.albedo, guides.normal, guides.brightness, step, precision, factors);
  return x.c == 4 ? y : slice(y, 0, 3);
}

TEST(JointFilter, CertaintyWeightsAndIsAveraged) {
  const Planes x(4, 1, 2, {1, 5, 1, 5, 1, 5, 1, 17});
  const Planes y = filtered(x, flat(1, 2), 1).value;
  const double left = (3 * 1 + 17 * 5) / 20.0, right = (1 + 3 * 17 * 5) / 52.0;
  expect_near(y, {left, right, left, right, left, right, 20 / 4.0, 52 / 4.0});
}

TEST(JointFilter, AUniformImageIsNoneTheWorse) {
  const Guides guides{exact(random(3, 9, 7, 0, 1, 1)), exact(random(3, 9, 7, -1, 1, 2)),
                      exact(random(1, 9, 7, 0, 1, 3))};
  for (const int step : {1, 2, 4, 8, 16}) {
    expect_near(filtered(uniform(3, 9, 7, 5), guides, step).value, std::vector<double>(3 * 9 * 7, 5));
  }
}

TEST(JointFilter, EqualGuidesLeaveTheBinomialKernel) {
  for (const int step : {1, 2}) {
    Planes x(3, 9, 9);
    x.at(1, 4, 4) = 16;
    const Planes y = filtered(x, flat(9, 9), step).value;
    for (int dy = -4; dy <= 4; ++dy) {
      for (int dx = -4; dx <= 4; ++dx) {
        const auto factor = [&](int d) { return d == 0 ? 2 : std::abs(d) == step ? 1 : 0; };
        EXPECT_NEAR(y.at(1, 4 + dy, 4 + dx), factor(dy) * factor(dx), 1e-12);
      }
    }
  }
}

TEST(JointFilter, EdgesAreReplicated) {
  const Planes x(3, 1, 3, {16, 0, 0, 0, 0, 16, 1, 1, 1});
  for (const int step : {2, 16}) {
    const Planes y = filtered(x, flat(1, 3), step).value;
    // A column has one pixel, which it repeats three times, so only 1/4, 1/2, 1/4 along the row are left.
    expect_near(y, {12, 4, 4, 4, 4, 12, 1, 1, 1});
  }
}

TEST(JointFilter, EveryGuideHasItsWidth) {
  const Planes x(3, 1, 2, {0, 1, 0, 1, 0, 1});
  const auto first = [&](int guide, int channel, double difference) {
    Guides guides = flat(1, 2);
    Bounded& changed = guide == 0 ? guides.albedo : guide == 1 ? guides.normal : guides.brightness;
    changed.value.at(channel, 0, 1) += difference;
    return filtered(x, guides, 1).value.at(0, 0, 0);
  };
  const auto expected = [](double distance) {
    const double weight = std::exp(-distance * distance);
    return 0.25 * weight / (0.75 + 0.25 * weight);
  };
  for (const int channel : {0, 1, 2}) {
    EXPECT_NEAR(first(0, channel, 0.5), expected(0.5 / 1.5), 1e-12);
    EXPECT_NEAR(first(1, channel, -0.6), expected(0.5), 1e-12);
  }
  EXPECT_NEAR(first(2, 0, 0.0667), expected(1), 1e-12);
  EXPECT_NEAR(first(2, 0, 20), 0, 1e-12);
}

TEST(JointFilter, FactorsMultiplyTheGuides) {
  const Planes x(3, 1, 2, {0, 1, 0, 1, 0, 1});
  Guides guides = flat(1, 2), multiplied = flat(1, 2);
  const GuideFactors factors{0.5, 3, 2};
  for (int c = 0; c < 3; ++c) {
    guides.albedo.value.at(c, 0, 1) += 0.2, multiplied.albedo.value.at(c, 0, 1) += 0.1;
    guides.normal.value.at(c, 0, 1) -= 0.1, multiplied.normal.value.at(c, 0, 1) -= 0.3;
  }
  guides.brightness.value.at(0, 0, 1) += 0.01, multiplied.brightness.value.at(0, 0, 1) += 0.02;
  EXPECT_NEAR(filtered(x, guides, 1, kFp32, factors).value.at(0, 0, 0),
              filtered(x, multiplied, 1).value.at(0, 0, 0), 1e-12);
}

TEST(Remodulate, UndoesDemodulate) {
  const Planes color = random(3, 4, 6, 0, 2, 1), albedo = random(3, 4, 6, 0, 1, 2);
  for (const Transfer transfer : {kLinear, kLog}) {
    const Bounded demodulated =
        demodulate(exact(color), exact(albedo), exact(Planes(6, 2, 3)), 0, transfer, 2, 0, kFp32);
    expect_near(remodulate(exact(slice(demodulated, 0, 3).value), exact(albedo), transfer, kFp32).value,
                color.data);
  }
}

// Mixes for one LRHS pixel: color 0.1, 0.2, 0.3, irradiance 1, 2, 3, albedo 0.6, and further candidates 11,
// 12 and 13 in all channels.
Planes mixed(const std::vector<double>& residual_and_logits, Transfer transfer) {
  std::vector<double> lrhs, rec;
  for (const double value : {0.1, 0.2, 0.3}) lrhs.push_back(value);
  for (const double value : {1, 2, 3}) lrhs.push_back(transfer == kLog ? encoded(value) : value);
  for (const double value : residual_and_logits) rec.insert(rec.end(), 4, value);
  return mix(exact(Planes(8, 2, 2, rec)), exact(Planes(6, 1, 1, lrhs)), exact(uniform(3, 2, 2, 0.6)),
             concat(concat(exact(uniform(3, 2, 2, 11)), exact(uniform(3, 2, 2, 12))),
                    exact(uniform(3, 2, 2, 13))),
             transfer, 2, 0, kFp32)
      .value;
}

TEST(Mix, OneLogitChoosesACandidate) {
  for (const Transfer transfer : {kLinear, kLog}) {
    for (int chosen = 0; chosen < 5; ++chosen) {
      std::vector<double> rec{0.25, 0.5, -0.5, -80, -80, -80, -80, -80};
      rec[size_t(3 + chosen)] = 80;
      const Planes y = mixed(rec, transfer);
      for (int c = 0; c < 3; ++c) {
        const double remodulated = transfer == kLog ? encoded(c + 1) : c + 1;  // albedo + 0.4 is 1
        const double candidate = chosen == 0 ? 0.1 * (c + 1) : chosen == 1 ? remodulated : 9 + chosen;
        EXPECT_NEAR(y.at(c, 1, 0), rec[size_t(c)] + candidate, 1e-12) << chosen;
      }
    }
  }
}

TEST(Mix, LogitsAreLogarithmsOfWeights) {
  const Planes y = mixed({0, 0, 0, -80, -80, std::log(5), std::log(2), std::log(1)}, kLinear);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(y.at(c, 0, 1), (5 * 11 + 2 * 12 + 13) / 8.0, 1e-12);
}

TEST(Mix, UpsamplesWithThePhase) {
  Planes rec(8, 2, 4);
  for (size_t i = 0; i < 8; ++i) rec.data[3 * 8 + i] = 80;
  const Planes lrhs(6, 1, 2, {0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  const Bounded y =
      mix(exact(rec), exact(lrhs), exact(Planes(3, 2, 4)), exact(Planes(9, 2, 4)), kLinear, 2, 0.5, kFp32);
  expect_near(slice(y, 0, 1).value, {0, 1, 3, 4, 0, 1, 3, 4});
}

// The bounds must admit a device that computes in floats, and reject wrong results that come close.
class JointBounds : public testing::TestWithParam<Precision> {
 protected:
  Planes stored(int c, double low, double high, uint64_t seed) const {
    return round_to(random(c, 16, 12, low, high, seed), GetParam());
  }
  const Planes x_ = concat(exact(stored(3, 0, 10, 1)), exact(stored(1, 1, 40, 9))).value;
  const Guides guides_{exact(stored(3, 0, 1, 2)), exact(stored(3, -1, 1, 3)), exact(stored(1, 0.4, 0.6, 4))};
};

Planes float_filter(const Planes& x, const Guides& guides, int step, float brightness_width,
                    Precision store) {
  Planes y = x;
  for (int row = 0; row < x.h; ++row) {
    for (int column = 0; column < x.w; ++column) {
      float sum[3] = {}, certainties = 0, weights = 0;
      for (int tap = 8; tap >= 0; --tap) {
        const int dy = tap / 3 - 1, dx = tap % 3 - 1;
        const int yy = std::clamp(row + dy * step, 0, x.h - 1),
                  xx = std::clamp(column + dx * step, 0, x.w - 1);
        const auto squared = [&](const Planes& guide, int c, float width) {
          const float off = (float(guide.at(c, yy, xx)) - float(guide.at(c, row, column))) / width;
          return off * off;
        };
        float distance = squared(guides.brightness.value, 0, brightness_width);
        for (int c = 0; c < 3; ++c) {
          distance += squared(guides.albedo.value, c, 1.5f) + squared(guides.normal.value, c, 1.2f);
        }
        const float weight = float((2 - std::abs(dy)) * (2 - std::abs(dx))) * std::exp(-distance);
        const float certainty = weight * float(x.at(3, yy, xx));
        for (int c = 0; c < 3; ++c) sum[c] += certainty * float(x.at(c, yy, xx));
        certainties += certainty;
        weights += weight;
      }
      for (int c = 0; c < 3; ++c) y.at(c, row, column) = round_to(sum[c] / certainties, store);
      y.at(3, row, column) = round_to(certainties / weights, store);
    }
  }
  return y;
}

TEST_P(JointBounds, FloatFilterStaysWithinAndOthersDoNot) {
  for (const int step : {1, 4}) {
    const Bounded expected = filtered(x_, guides_, step, GetParam());
    const auto within = [&](int step, float width) {
      return within_bounds("joint_filter", float_filter(x_, guides_, step, width, GetParam()), expected);
    };
    EXPECT_TRUE(within(step, 0.0667f));
    EXPECT_FALSE(within(step + 1, 0.0667f));
    EXPECT_FALSE(within(step, 0.067f));
    const Planes bounds = slice(expected, 0, 3).bound;
    const double largest = *std::ranges::max_element(bounds.data);
    EXPECT_LT(largest, GetParam() == kFp32 ? 2e-4 : 6e-3);  // the values are from 0 to 10
    const Planes certainty = slice(expected, 3, 1).bound;
    const double largest_certainty = *std::ranges::max_element(certainty.data);
    EXPECT_LT(largest_certainty, GetParam() == kFp32 ? 8e-4 : 2.4e-2);  // the values are from 1 to 40
  }
}

TEST_P(JointBounds, FloatMixStaysWithinAndOthersDoNot) {
  const Planes rec = stored(8, -2, 2, 5), albedo = stored(3, 0, 1, 6), candidates = stored(9, 0, 2, 7);
  const Planes lrhs = round_to(random(6, 4, 3, 0, 2, 8), GetParam());
  const Bounded expected =
      mix(exact(rec), exact(lrhs), exact(albedo), exact(candidates), kLog, 4, 1.5, GetParam());
  const Planes low = bilinear(exact(lrhs), 4, 1.5).value;
  const auto device = [&](float floor) {
    Planes y(3, 16, 12);
    for (int c = 0; c < 3; ++c) {
      for (int row = 0; row < y.h; ++row) {
        for (int column = 0; column < y.w; ++column) {
          const float irradiance = (std::exp(3 * float(low.at(3 + c, row, column))) - 1) / 8;
          const float remodulated =
              std::log(1 + 8 * irradiance * (float(albedo.at(c, row, column)) + floor)) / 3;
          float sum = 0, weights = 0;
          for (int i = 0; i < 5; ++i) {
            const float weight = std::exp(float(rec.at(3 + i, row, column)) - 2);
            sum += weight * (i == 0   ? float(low.at(c, row, column))
                             : i == 1 ? remodulated
                                      : float(candidates.at(3 * (i - 2) + c, row, column)));
            weights += weight;
          }
          y.at(c, row, column) = round_to(float(rec.at(c, row, column)) + sum / weights, GetParam());
        }
      }
    }
    return y;
  };
  EXPECT_TRUE(within_bounds("mix", device(0.4f), expected));
  EXPECT_FALSE(within_bounds("mix", device(0.41f), expected));
  EXPECT_LT(*std::ranges::max_element(expected.bound.data), GetParam() == kFp32 ? 3e-5 : 3e-3);
}

// Inputs that are off by their bounds move the output by no more than its bound.
TEST_P(JointBounds, InputsBoundsAreCarried) {
  const auto widen = [](Bounded x, double bound) {
    std::ranges::fill(x.bound.data, bound);
    return x;
  };
  const auto moved = [](const Planes& x, double bound, uint64_t seed) {
    Planes y = random_planes(x.c, x.h, x.w, Fill::kUniform, seed);
    for (size_t i = 0; i < y.data.size(); ++i) y.data[i] = x.data[i] + (y.data[i] < 0 ? -bound : bound);
    return y;
  };
  constexpr double kOff = 1e-3;
  const Bounded filter =
      joint_filter(widen(exact(x_), kOff), widen(guides_.albedo, kOff), widen(guides_.normal, kOff),
                   widen(guides_.brightness, kOff), 1, GetParam());
  const Planes rec = stored(8, -2, 2, 5), albedo = stored(3, 0, 1, 6), candidates = stored(9, 0, 2, 7);
  const Planes lrhs = random(6, 4, 3, 0, 2, 8);
  const Bounded mixed = mix(widen(exact(rec), kOff), widen(exact(lrhs), kOff), widen(exact(albedo), kOff),
                            widen(exact(candidates), kOff), kLog, 4, 0, GetParam());
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const auto off = [&](const Planes& x) { return exact(moved(x, 0.999 * kOff, seed + size_t(x.c))); };
    EXPECT_TRUE(within_bounds("carried joint_filter",
                              joint_filter(off(x_), off(guides_.albedo.value), off(guides_.normal.value),
                                           off(guides_.brightness.value), 1, GetParam())
                                  .value,
                              filter));
    EXPECT_TRUE(within_bounds(
        "carried mix", mix(off(rec), off(lrhs), off(albedo), off(candidates), kLog, 4, 0, GetParam()).value,
        mixed));
  }
  EXPECT_LT(*std::ranges::max_element(filter.bound.data), 1);
  EXPECT_LT(*std::ranges::max_element(mixed.bound.data), 0.05);
}

INSTANTIATE_TEST_SUITE_P(Precisions, JointBounds, testing::Values(kFp32, Precision::kFp16),
                         [](const auto& info) { return info.param == kFp32 ? "fp32" : "fp16"; });

TEST(JointBase, OtherShapesAreRefused) {
  const Bounded low = exact(Planes(3, 1, 1)), full = exact(Planes(3, 2, 2)), one = exact(Planes(1, 2, 2));
  EXPECT_THROW(irradiance(low, low, low, kLog, 2, 0, kFp32), std::invalid_argument);
  EXPECT_THROW(demodulate(full, full, full, 1, kLog, 2, 0, kFp32), std::invalid_argument);
  EXPECT_THROW(joint_filter(full, full, full, full, 1, kFp32), std::invalid_argument);
  EXPECT_THROW(remodulate(one, full, kLog, kFp32), std::invalid_argument);
  EXPECT_THROW(mix(full, low, full, full, kLog, 2, 0, kFp32), std::invalid_argument);
}

}  // namespace
}  // namespace raymeld::reference
