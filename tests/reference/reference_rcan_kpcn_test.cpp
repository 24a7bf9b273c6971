// Tests the reference's layers of RCAN and KPCN by cases that were computed by hand.
#include <gtest/gtest.h>

#include <cmath>

#include "expect_near.h"
#include "reference/reference.h"

namespace raymeld::reference {
namespace {

using test::expect_near;

constexpr auto kFp32 = Precision::kFp32;
constexpr auto kLog = Transfer::kLog, kLinear = Transfer::kLinear;

TEST(Gradients, AreAlongXAndThenAlongY) {
  const Planes x(1, 2, 3, {1, 3, 7, 2, 2, -1});
  expect_near(gradients(exact(x), kFp32), {2, 4, 0, 0, -3, 0, 1, -1, -8, 0, 0, 0});
}

TEST(Gradients, OfAllChannelsAlongXComeFirst) {
  const Planes x(2, 1, 2, {1, 5, 10, 30});
  expect_near(gradients(exact(x), kFp32), {4, 0, 20, 0, 0, 0, 0, 0});
}

TEST(Remainder, IsWhatThePartLeaves) {
  const Planes whole(3, 1, 1, {5, 2, 1}), part(3, 1, 1, {2, 2, 4});
  expect_near(remainder(exact(whole), exact(part), kLinear, kFp32), {3, 0, 0});
  const auto encoded = [](double x) { return std::log(1 + 8 * x) / 3; };
  const Planes whole_log(3, 1, 1, {encoded(5), encoded(2), encoded(1)}),
      part_log(3, 1, 1, {encoded(2), encoded(2), encoded(4)});
  expect_near(remainder(exact(whole_log), exact(part_log), kLog, kFp32), {encoded(3), 0, 0});
}

TEST(Remodulate, MultipliesByTheAlbedoAndAddsTheRest) {
  const auto light = [](double x) { return std::log(1 + 0.2 * x) / 0.2; };
  const Planes in(3, 1, 1, {light(0), light(5), light(2)}), albedo(3, 1, 1, {1, 0.6, 0}),
      rest(3, 1, 1, {3, 0, 1});
  expect_near(remodulate(exact(in), exact(albedo), exact(rest), kLinear, kFp32), {3, 5, 1.8});
  const auto encoded = [](double x) { return std::log(1 + 8 * x) / 3; };
  const Planes rest_log(3, 1, 1, {encoded(3), 0, encoded(1)});
  expect_near(remodulate(exact(in), exact(albedo), exact(rest_log), kLog, kFp32),
              {encoded(3), encoded(5), encoded(1.8)});
}

TEST(Remodulate, RefusesOtherShapes) {
  const Bounded one = exact(Planes(3, 1, 1)), two = exact(Planes(3, 2, 2));
  EXPECT_THROW(remodulate(two, one, two, kLog, kFp32), std::invalid_argument);
  EXPECT_THROW(remodulate(two, two, one, kLog, kFp32), std::invalid_argument);
}

TEST(ChannelMeans, AreOverAllPixels) {
  const Planes x(2, 2, 3, {1, 2, 3, 4, 5, 9, -1, -1, 0, 0, 0, -4});
  expect_near(channel_means(exact(x), kFp32), {4, -1});
}

TEST(Attend, ScalesByTheSigmoidAndAdds) {
  const Planes x(2, 1, 2, {2, 4, 10, 20}), logits(2, 1, 1, {0, std::log(4.0)}),
      residual(2, 1, 2, {1, 1, 0, -1});
  expect_near(attend(exact(x), exact(logits), exact(residual), kFp32), {2, 3, 8, 15});
}

TEST(Attend, LimitsLogits) {
  const Planes x(2, 1, 1, {3, std::exp(80.0)}), residual(2, 1, 1), logits(2, 1, 1, {1e6, -1e6});
  expect_near(attend(exact(x), exact(logits), exact(residual), kFp32), {3, 1});
}

}  // namespace
}  // namespace raymeld::reference
