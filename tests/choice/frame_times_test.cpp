// Tests that the time of a frame is measured once and kept.
#include "choice/frame_times.h"

#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "fusion/tuner.h"
#include "golden.h"
#include "gpu.h"

namespace raymeld::test {
namespace {

class FrameTimesTest : public GpuTest {
 protected:
  std::filesystem::path only_file() const {
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
      if (entry.path().filename().string().starts_with("times-")) return entry.path();
    }
    return {};
  }

  TemporaryDirectory folder_;
  const Model model_{golden_model_path(4)};
};

TEST_F(FrameTimesTest, AreKeptByWhatTheyDependOn) {
  FrameTimes times(gpu(), folder_.path());
  const FuserOptions options;
  EXPECT_FALSE(times.known(model_, 6, 8, options));
  const FrameTime time = times.measure(model_, 6, 8, options);
  EXPECT_GT(time.first_ms, 0);
  EXPECT_GT(time.further_ms, 0);
  EXPECT_EQ(times.known(model_, 6, 8, options), time);
  EXPECT_EQ(FrameTimes(gpu(), folder_.path()).known(model_, 6, 8, options), time);
  EXPECT_FALSE(times.known(model_, 8, 6, options));
  EXPECT_FALSE(times.known(Model(golden_model_path("guided-x4")), 6, 8, options));
  FuserOptions other = options;
  other.storage = Storage::kFloat16;
  EXPECT_FALSE(times.known(model_, 6, 8, other));
  other = options;
  other.kernels = default_kernels(gpu().info(), Storage::kFloat32);
  const Conv2dShape shape{.height = 64, .width = 64, .channels_in = 32, .channels_out = 32, .kernel = 3};
  const bool differ = other.kernels.conv2d(shape).algorithm != Algorithm::kDirect;
  EXPECT_EQ(times.known(model_, 6, 8, other).has_value(), !differ);
  other = options;
  other.constants = {{"albedo", {}}};
  EXPECT_FALSE(times.known(model_, 6, 8, other));
}

TEST_F(FrameTimesTest, ModelsThatReadOneRenderAreMeasured) {
  for (const char* name : {"pyramid-x1", "edsr-x4"})
    EXPECT_GT(FrameTimes(gpu(), folder_.path()).measure(Model(golden_model_path(name)), 16, 16, {}).first_ms,
              0);
}

// The test's clock decides how long every frame takes.
TEST_F(FrameTimesTest, AreTheFirstAndTheMedianOfTheFurther) {
  const std::vector<double> frames_ms{50, 9, 2, 7};
  size_t asked = 0;
  double now_ms = 1000;
  FrameTimes times(gpu(), {}, [&] { return now_ms += asked++ % 2 ? frames_ms.at(asked / 2 - 1) : 100; });
  EXPECT_EQ(times.measure(model_, 6, 8, {}), (FrameTime{.first_ms = 50, .further_ms = 7}));
  EXPECT_EQ(asked, 2 * frames_ms.size());
}

// 75x75 pixels of LRHS make 90,000 fused ones; only 45x45 pixels of LRHS are computed.
TEST_F(FrameTimesTest, LargeFramesAreMeasuredAsPartsOfThem) {
  double now_ms = 0;
  FrameTimes times(
      gpu(), folder_.path(), [&] { return now_ms += 10; }, 1 << 15);
  const FrameTime time = times.measure(model_, 75, 75, {});
  const double parts = 75.0 * 75 / (45 * 45);
  EXPECT_GE(time.first_ms, 10 * parts);
  EXPECT_LE(time.first_ms, 12 * parts);
  EXPECT_EQ(time.further_ms, time.first_ms);
  EXPECT_EQ(times.known(model_, 75, 75, {}), time);
}

TEST(SteadyMs, CountsMilliseconds) {
  using Milliseconds = std::chrono::duration<double, std::milli>;
  const auto start = std::chrono::steady_clock::now();
  const double before_ms = steady_ms();
  std::this_thread::sleep_for(Milliseconds(20));
  const double passed_ms = steady_ms() - before_ms;
  EXPECT_GE(passed_ms, 20);
  EXPECT_LE(passed_ms, Milliseconds(std::chrono::steady_clock::now() - start).count());
}

TEST_F(FrameTimesTest, AreForgotten) {
  FrameTimes(gpu(), folder_.path()).measure(model_, 6, 8, {});
  ASSERT_FALSE(only_file().empty());
  FrameTimes::forget(gpu(), folder_.path());
  EXPECT_TRUE(only_file().empty());
  FrameTimes::forget(gpu(), folder_.path());  // forgetting twice is no error
}

TEST_F(FrameTimesTest, WhatIsNoFileHoldsNoTimes) {
  FrameTimes(gpu(), folder_.path()).measure(model_, 6, 8, {});
  for (const char* content : {"", "{", "[]", R"({"format_version": 1})", R"({"format_version": 3})",
                              R"({"format_version": 3, "times_ms": {"a": "b"}})"}) {
    write_file(only_file(), content);
    EXPECT_FALSE(FrameTimes(gpu(), folder_.path()).known(model_, 6, 8, {})) << content;
  }
}

TEST_F(FrameTimesTest, WithoutAFolderTheyAreKeptInMemory) {
  FrameTimes times(gpu(), {});
  const FrameTime time = times.measure(model_, 6, 8, {});
  EXPECT_EQ(times.known(model_, 6, 8, {}), time);
}

}  // namespace
}  // namespace raymeld::test
