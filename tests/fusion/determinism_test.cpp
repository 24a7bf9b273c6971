// Tests that the output has the same bits, whatever differs from run to run.
#include <gtest/gtest.h>

#include <cmath>

#include "cli_fixture.h"
#include "conform/model_file.h"
#include "fusion/fuser.h"
#include "fusion/tuner.h"
#include "subject.h"

namespace raymeld::test {
namespace {

class DeterminismTest : public GpuTest {
 protected:
  struct Fused {
    std::vector<float> values;
    uint32_t tiles = 0;
    uint64_t peak_bytes = 0;
    int submits = 0;
  };

  Fused fuse(const FuserOptions& options) const {
    Fuser fuser(gpu(), model_, kHeight, kWidth, options, shared_cache_folder());
    Fused result{{}, fuser.plan().tiling.count(), fuser.plan().peak_bytes()};
    Image fused;
    fuser.fuse(image_of(subject_.lrhs), image_of(subject_.hrls), fused,
               [&](double) { return ++result.submits > 0; });
    result.values = fused.data;
    return result;
  }

  // Fuses the frame with each tiling that it is ever cut into, from one tile to the smallest.
  std::vector<Fused> in_all_tilings(FuserOptions options) const {
    std::vector<Fused> all;
    while (true) {
      try {
        plan_fusion(model_, kHeight, kWidth, gpu().info(), options);
      } catch (const Error&) {
        return all;
      }
      all.push_back(fuse(options));
      options.max_memory_bytes = all.back().peak_bytes - 1;
    }
  }

  static constexpr uint32_t kHeight = 14, kWidth = 21;
  Subject subject_ = make_subject(small_architecture(2), kHeight, kWidth, 1);
  TemporaryDirectory folder_;
  Model model_ = (write_model(folder_ / "model.safetensors", subject_.architecture, subject_.weights),
                  Model(folder_ / "model.safetensors"));
};

TEST_F(DeterminismTest, EveryTilingGivesTheSameBitsWithDirectKernels) {
  for (const Storage storage : {Storage::kFloat32, Storage::kFloat16}) {
    const std::vector<Fused> all = in_all_tilings({.storage = storage});
    EXPECT_GE(all.size(), 3u);
    EXPECT_EQ(all.front().tiles, 1u);
    EXPECT_GT(all.back().tiles, 4u);
    for (const Fused& tiled : all) EXPECT_TRUE(same_bits(tiled.values, all.front().values)) << tiled.tiles;
  }
}

// Winograd rounds a pixel by its place in its tile's blocks of 2x2 or 4x4.
TEST_F(DeterminismTest, EveryTilingOfFastKernelsRepeatsAndAgreesWithinRounding) {
  const Kernels kernels = default_kernels(gpu().info(), Storage::kFloat32);
  if (!gpu().info().buffer_device_address) GTEST_SKIP() << "the device has direct kernels only";
  const std::vector<Fused> all = in_all_tilings({.kernels = kernels}),
                           again = in_all_tilings({.kernels = kernels});
  const std::vector<float> direct = fuse({}).values;
  ASSERT_EQ(all.size(), again.size());
  EXPECT_GE(all.size(), 3u);
  float most = 0, difference = 0;
  for (const float value : direct) most = std::max(most, std::abs(value));
  for (size_t i = 0; i < all.size(); ++i) {
    EXPECT_TRUE(same_bits(all[i].values, again[i].values)) << all[i].tiles;
    for (size_t at = 0; at < direct.size(); ++at)
      difference = std::max(difference, std::abs(all[i].values[at] - all[0].values[at]));
  }
  EXPECT_GT(difference, 0) << "fast kernels were not used";
  EXPECT_LE(difference, 0x1p-19f * most);
}

TEST_F(DeterminismTest, EverySplitOfTheWorkGivesTheSameBits) {
  for (const Kernels& kernels : {Kernels{}, default_kernels(gpu().info(), Storage::kFloat32)}) {
    const Fused whole =
        fuse({.kernels = kernels, .work_limits = WorkLimits{.dispatch_work = 1e12, .submit_work = 1e12}});
    EXPECT_EQ(whole.submits, 1);
    int submits = whole.submits;
    const WorkLimits tried[] = {
        {.dispatch_work = 1e12, .submit_work = 1e6}, {.dispatch_work = 1e12, .submit_work = 1e5},
        {.dispatch_work = 1e5, .submit_work = 1e6},  {.dispatch_work = 3e4, .submit_work = 1e5},
        {.dispatch_work = 1e3, .submit_work = 1e12}, {.dispatch_work = 1, .submit_work = 1},
    };
    for (const WorkLimits& limits : tried) {
      const Fused split = fuse({.kernels = kernels, .work_limits = limits});
      EXPECT_TRUE(same_bits(split.values, whole.values))
          << limits.dispatch_work << ", " << limits.submit_work;
      submits = std::max(submits, split.submits);
    }
    EXPECT_GT(submits, 10);
  }
}

// Dispatches may begin at any workgroup, also those of kernels that compute vectors of pixels.
TEST_F(DeterminismTest, EverySplitOfOtherLayersGivesTheSameBits) {
  for (const reference::Architecture& a : {pyramid_architecture(2), rcan_architecture(2)}) {
    const Subject subject = make_subject(a, 20, 70, 1);
    const Model model(conform::model_file(subject.architecture, subject.weights), "model");
    Image whole, split;
    const WorkLimits tried[] = {
        {.dispatch_work = 1e12, .submit_work = 1e12},
        {.dispatch_work = 1e5, .submit_work = 1e6},
        {.dispatch_work = 1e4, .submit_work = 1e12},
    };
    for (const WorkLimits& limits : tried) {
      Fuser fuser(gpu(), model, 20, 70,
                  {.kernels = default_kernels(gpu().info(), Storage::kFloat32), .work_limits = limits},
                  shared_cache_folder());
      fuser.fuse(image_of(subject.lrhs), image_of(subject.hrls), whole.data.empty() ? whole : split);
      EXPECT_TRUE(split.data.empty() || same_bits(split.data, whole.data)) << limits.dispatch_work;
    }
  }
}

// Sets the number of threads of Mesa's driver for CPUs; other drivers ignore it.
class DriverThreadsTest : public Cli {};

TEST_F(DriverThreadsTest, EveryNumberOfThreadsGivesTheSameFile) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 24, 16, 1));
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 96, 64, 2));
  for (const char* kernels : {"auto", "direct"}) {
    std::string expected;
    for (const char* threads : {"0", "1", "2", "3", "8"}) {
      environment_["LP_NUM_THREADS"] = threads;
      const ProcessResult result = run(fuse({"--kernels", kernels, "--output-type", "float"}));
      ASSERT_EQ(result.exit_status, 0) << result.err;
      const std::string file = read_file(folder_ / "out.exr");
      if (expected.empty()) expected = file;
      EXPECT_EQ(file == expected, true) << threads << " threads, " << kernels;
    }
  }
}

}  // namespace
}  // namespace raymeld::test
