// Tests that tiles that did not change are not computed, and that the bits are those of a whole frame.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <limits>

#include "error_of.h"
#include "fusion/fuser.h"
#include "fusion/tuner.h"
#include "networks/network.h"
#include "subject.h"

namespace raymeld::test {
namespace {

using reference::Architecture;

constexpr int kHeight = 21, kWidth = 180;

struct Scene {
  Image lrhs, hrls;
};

struct Fused {
  Image image;
  FuseReport report;
};

class ChangedTest : public GpuTest {
 protected:
  Model model_of(const Architecture& a, const reference::Weights& weights) {
    write_model(folder_ / "model.safetensors", a, weights);
    return Model(folder_ / "model.safetensors");
  }
  Model model_of(const Architecture& a) { return model_of(a, make_subject(a, 2, 2, 5).weights); }

  Scene make_scene(const Architecture& a, uint64_t seed) {
    const Subject subject = make_subject(a, kHeight, kWidth, seed);
    return {image_of(subject.lrhs), image_of(subject.hrls)};
  }

  Fuser make(const Model& model, FuserOptions options, bool skip_unchanged = true) {
    options.skip_unchanged = skip_unchanged;
    return Fuser(gpu(), model, kHeight, kWidth, options, shared_cache_folder());
  }

  Fused fuse(Fuser& fuser, const Scene& scene, const Progress& progress = {}, float exposure = 0) {
    Fused fused;
    fused.report = fuser.fuse(scene.lrhs, scene.hrls, fused.image, progress, exposure);
    return fused;
  }

  // Cancels a frame first, so that the Fuser has no last frame and computes all tiles.
  Fused fuse_whole(Fuser& fuser, const Scene& scene) {
    EXPECT_THROW(fuse(fuser, scene, [](double) { return false; }), Cancelled);
    return fuse(fuser, scene);
  }

  TemporaryDirectory folder_;
};

// Returns options under which a frame takes several tiles.
FuserOptions tiled(const Model& model, FuserOptions options) {
  options.skip_unchanged = true;
  options.max_memory_bytes = plan_fusion(model, kHeight, kWidth, gpu().info(), options).peak_bytes() / 2;
  return options;
}

// Zeros of either sign are the same to the network, but not to a comparison of bits.
TEST_F(ChangedTest, BitsAreComparedAndNotValues) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  Fuser fuser = make(model, {});
  Scene scene = make_scene(a, 8);
  scene.hrls.at(0, 0, 0) = 0.0f;
  const Image first = fuse(fuser, scene).image;
  scene.hrls.at(0, 0, 0) = -0.0f;
  const Fused fused = fuse(fuser, scene);
  EXPECT_LT(fused.report.skipped_share, 1);
  EXPECT_EQ(fused.image.data, first.data);
}

// A tile that reads no changed pixel is skipped, and a tile whose halo alone changed is computed. The bits
// are those of a frame that is computed as a whole.
TEST_F(ChangedTest, TilesThatDoNotChangeAreSkipped) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  for (const Kernels& kernels : {Kernels{}, default_kernels(gpu().info(), Storage::kFloat32)}) {
    SCOPED_TRACE(kernels.addressed);
    const FuserOptions options = tiled(model, {.kernels = kernels});
    Fuser fuser = make(model, options), whole = make(model, options);
    const Tiling tiling = fuser.plan().tiling;
    ASSERT_GT(tiling.columns, 1u);
    Scene scene = make_scene(a, 8);
    EXPECT_EQ(fuse(fuser, scene).report.skipped_share, 0);
    const auto expect_skipped = [&](uint32_t y, uint32_t x) {
      const Fused fused = fuse(fuser, scene);
      EXPECT_TRUE(same_bits(fused.image.data, fuse_whole(whole, scene).image.data));
      double skipped = 0;
      for (uint32_t i = 0; i < tiling.count(); ++i) {
        const Tile at = tiling.at(i);
        const bool reads =
            at.x <= x && x < at.x + tiling.tile.width && at.y <= y && y < at.y + tiling.tile.height;
        if (!reads) skipped += at.core.height * at.core.width;
      }
      EXPECT_DOUBLE_EQ(fused.report.skipped_share, skipped / (kHeight * kWidth));
    };
    const int seam = int(tiling.at(1).core_x), halo = int(tiling.halo);
    for (const int x :
         {0, seam - halo - 1, seam - halo, seam - 1, seam, seam + halo - 1, seam + halo, kWidth - 1}) {
      SCOPED_TRACE(x);
      scene.lrhs.at(1, 10, x) += 1;
      expect_skipped(10, uint32_t(x));
      scene.hrls.at(4, 2 * kHeight - 1, 2 * x + 1) += 1;
      expect_skipped(kHeight - 1, uint32_t(x));
    }
    const Fused same = fuse(fuser, scene);
    EXPECT_EQ(same.report.skipped_share, 1);
    EXPECT_EQ(same.report.device_ms, 0);
    scene = make_scene(a, 9);
    EXPECT_EQ(fuse(fuser, scene).report.skipped_share, 0);
  }
}

TEST_F(ChangedTest, AfterAFrameThatWasGivenUpAllIsComputed) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  for (const FuserOptions& options : {FuserOptions{}, tiled(model, {})}) {
    Fuser fuser = make(model, options);
    const Scene scene = make_scene(a, 8), other = make_scene(a, 9);
    const Image expected = fuse(fuser, scene).image;
    EXPECT_THROW(fuse(fuser, other, [](double) { return false; }), Cancelled);
    const Fused cancelled = fuse(fuser, scene);
    EXPECT_TRUE(same_bits(cancelled.image.data, expected.data));
    EXPECT_EQ(cancelled.report.skipped_share, 0);
    const auto fail = [](double share) -> bool {
      if (share > 0.5) throw Error("half of it is enough");
      return true;
    };
    EXPECT_ERROR(fuse(fuser, other, fail), "half of it");
    EXPECT_TRUE(same_bits(fuse(fuser, scene).image.data, expected.data));
    // A frame in which nothing is computed can be cancelled too.
    EXPECT_THROW(fuse(fuser, scene, [](double) { return false; }), Cancelled);
    EXPECT_EQ(fuse(fuser, scene).report.skipped_share, 0);
    EXPECT_EQ(fuse(fuser, scene).report.skipped_share, 1);
  }
}

TEST_F(ChangedTest, AnotherExposureIsAnotherFrame) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  Fuser fuser = make(model, {}), whole = make(model, {}, false);
  const Scene scene = make_scene(a, 8);
  fuse(fuser, scene, {}, 1);
  for (const float exposure : {3.0f, 1.0f}) {
    const Fused fused = fuse(fuser, scene, {}, exposure);
    EXPECT_EQ(fused.report.skipped_share, 0);
    EXPECT_TRUE(same_bits(fused.image.data, fuse(whole, scene, {}, exposure).image.data));
    EXPECT_EQ(fuse(fuser, scene, {}, exposure).report.skipped_share, 1);
  }
}

// A tile that fp16 cannot hold is computed in fp32 as a whole, whichever part of it changed.
TEST_F(ChangedTest, WhatOverflowsIsComputedAgainAsAWhole) {
  if (!gpu().info().storage_16bit) GTEST_SKIP() << "no 16-bit storage";
  const Architecture a = small_architecture(2);
  reference::Weights weights = make_subject(a, 2, 2, 5).weights;
  for (auto& [name, conv] : weights) std::ranges::fill(conv.bias, 0);
  for (double& w : weights.at("rec").weight) w = w < 0 ? -6e4 : 6e4;
  const Model model = model_of(a, weights);
  Scene scene = make_scene(a, 8);
  for (Image* image : {&scene.lrhs, &scene.hrls}) std::ranges::fill(image->data, 0.0f);
  for (const bool redo : {true, false}) {
    FuserOptions options{.storage = Storage::kFloat16};
    if (redo) options.fp32_kernels = Kernels{};
    for (const FuserOptions& cut : {options, tiled(model, options)}) {
      SCOPED_TRACE(fmt::format("redo {}, {} bytes", redo, cut.max_memory_bytes));
      Fuser fuser = make(model, cut), whole = make(model, cut);
      const auto light = [&](int x, float value) {
        for (int c = 0; c < 3; ++c) std::fill_n(&scene.lrhs.at(c, 10, x), 4, value);
      };
      const auto fused = [&] {
        const Fused fused = fuse(fuser, scene), expected = fuse_whole(whole, scene);
        EXPECT_TRUE(same_bits(fused.image.data, expected.image.data));
        EXPECT_EQ(fused.report.redone_tiles, expected.report.redone_tiles);
        EXPECT_EQ(fused.report.status.saturated, expected.report.status.saturated);
        return fused.report.redone_tiles + fused.report.status.saturated;
      };
      light(20, 100);
      EXPECT_GT(fused(), 0u);
      light(170, 1e-6f);  // far from the first light, and small
      EXPECT_GT(fused(), 0u);
      EXPECT_GT(fused(), 0u);  // nothing changed
      light(20, 0);
      EXPECT_EQ(fused(), 0u);
      light(170, 100);
      EXPECT_GT(fused(), 0u);
      light(170, 0);
      EXPECT_EQ(fused(), 0u);
    }
  }
}

// A model without LRHS skips tiles and computes tiles again as others do. Its levels reach far, so that the
// frame is wide.
TEST_F(ChangedTest, AModelOfHrlsAloneDoesTheSame) {
  if (!gpu().info().storage_16bit) GTEST_SKIP() << "no 16-bit storage";
  constexpr uint32_t kRows = 3, kColumns = 700;
  const Architecture a = pyramid_architecture(1);
  Subject subject = make_subject(a, kRows, kColumns, 5);
  for (double& w : subject.weights.at("kernel.1").weight) w = w < 0 ? -6e4 : 6e4;
  const Model model = model_of(a, subject.weights);
  FuserOptions options{.storage = Storage::kFloat16, .fp32_kernels = Kernels{}};
  const auto make_for = [&](const FuserOptions& with) {
    return Fuser(gpu(), model, kRows, kColumns, with, shared_cache_folder());
  };
  Fuser whole = make_for(options);
  options.skip_unchanged = true;
  options.max_memory_bytes = whole.plan().peak_bytes();
  Fuser fuser = make_for(options);
  ASSERT_GT(fuser.plan().tiling.count(), 1u);
  Image hrls = image_of(subject.hrls), fused, expected;
  const FuseReport first = fuser.fuse({}, hrls, fused);
  EXPECT_GT(first.redone_tiles, 0u);
  EXPECT_GT(whole.fuse({}, hrls, expected).redone_tiles, 0u);
  EXPECT_TRUE(same_bits(fused.data, expected.data));
  hrls.at(0, 1, 5) += 1;
  fuser.fuse({}, hrls, fused, {}, first.exposure);
  whole.fuse({}, hrls, expected, {}, first.exposure);
  EXPECT_TRUE(same_bits(fused.data, expected.data));
}

// Frames of different sequences are not compared with each other.
TEST_F(ChangedTest, EachSequenceHasALastFrame) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  Fuser fuser = make(model, {});
  const std::array scenes = {make_scene(a, 8), make_scene(a, 9)};
  std::array<Image, 2> first;
  for (const double skipped : {0, 1}) {
    for (size_t i : {0, 1}) {
      Image fused;
      EXPECT_EQ(fuser.fuse(scenes[i].lrhs, scenes[i].hrls, fused, {}, 1, i).skipped_share, skipped) << i;
      if (skipped == 0) first[i] = fused;
      EXPECT_EQ(fused.data, first[i].data) << i;
    }
  }
  EXPECT_NE(first[0].data, first[1].data);
}

TEST_F(ChangedTest, WhoCannotKnowWhatChangedIsTold) {
  const Model model = model_of(small_architecture(2));
  Fuser fuser = make(model, {});
  EXPECT_ERROR(fuser.record(VK_NULL_HANDLE, FrameBindings{}), "record()", "skip_unchanged");
}

}  // namespace
}  // namespace raymeld::test
