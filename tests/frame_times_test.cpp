// How long frames take is measured once.
#include "frame_times.h"

#include <gtest/gtest.h>

#include <fstream>

#include "golden.h"
#include "gpu.h"
#include "tuner.h"

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
  // All but the threshold: times are those of frames in which everything is computed.
  FuserOptions other = options;
  other.threshold = 0.01f;
  EXPECT_EQ(times.known(model_, 6, 8, other), time);
  EXPECT_FALSE(times.known(model_, 8, 6, options));
  EXPECT_FALSE(times.known(Model(golden_model_path("guided-x4")), 6, 8, options));
  other = options;
  other.storage = Storage::kFloat16;
  EXPECT_FALSE(times.known(model_, 6, 8, other));
  other = options;
  other.kernels = default_kernels(gpu().info());
  const bool differ = other.kernels.conv2d({64, 64, 32, 32, 3}).tile > 0;
  EXPECT_EQ(times.known(model_, 6, 8, other).has_value(), !differ);
  other = options;
  other.constants = {{"albedo", {}}};
  EXPECT_FALSE(times.known(model_, 6, 8, other));
}

TEST_F(FrameTimesTest, LargeFramesAreMeasuredAsPartsOfThem) {
  FrameTimes times(gpu(), folder_.path());
  // 5.8 million pixels, of which a third are computed.
  EXPECT_GT(times.measure(model_, 600, 600, {}).further_ms, 0);
  EXPECT_TRUE(times.known(model_, 600, 600, {}));
}

TEST_F(FrameTimesTest, AreForgotten) {
  FrameTimes(gpu(), folder_.path()).measure(model_, 6, 8, {});
  ASSERT_FALSE(only_file().empty());
  FrameTimes::forget(gpu(), folder_.path());
  EXPECT_TRUE(only_file().empty());
  FrameTimes::forget(gpu(), folder_.path());  // once more is no error
}

TEST_F(FrameTimesTest, WhatIsNoFileHoldsNoTimes) {
  FrameTimes(gpu(), folder_.path()).measure(model_, 6, 8, {});
  for (const char* content : {"", "{", "[]", R"({"format_version": 1})", R"({"format_version": 2})",
                              R"({"format_version": 2, "times_ms": {"a": "b"}})"}) {
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
