// What did not change is not computed, and the bits are those of a whole frame.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <limits>

#include "error_of.h"
#include "fuser.h"
#include "fuser_options.h"
#include "network.h"
#include "subject.h"
#include "tuner.h"

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

  Fuser make(const Model& model, FuserOptions options, bool changed_only = true) {
    options.changed_only = changed_only;
    return Fuser(gpu(), model, kHeight, kWidth, options, shared_cache_folder());
  }

  Fused fuse(Fuser& fuser, const Scene& scene, const Progress& progress = {}, float exposure = 0) {
    Fused fused;
    fused.report = fuser.fuse(scene.lrhs, scene.hrls, fused.image, progress, exposure);
    return fused;
  }

  // The same by a Fuser that then has no last frame.
  Fused fuse_whole(Fuser& fuser, const Scene& scene) {
    EXPECT_THROW(fuse(fuser, scene, [](double) { return false; }), Cancelled);
    return fuse(fuser, scene);
  }

  TemporaryDirectory folder_;
};

// Options under which a frame takes several tiles.
FuserOptions tiled(const Model& model, FuserOptions options) {
  options.changed_only = true;
  options.max_memory_bytes = plan_fusion(model, kHeight, kWidth, gpu().info(), options).peak_bytes() / 2;
  return options;
}

TEST_F(ChangedTest, FramesHaveTheBitsOfWholeOnes) {
  const auto flip = [](float& value) {
    value = std::bit_cast<float>(std::bit_cast<uint32_t>(value) ^ 0x400000u);
  };
  size_t combinations = 0;
  for (const Architecture& a : {joint_architecture(2), small_architecture(4), cells_architecture(2)}) {
    const Model model = model_of(a);
    const int right = a.scale * kWidth - 1, bottom = a.scale * kHeight - 1;
    const std::vector<std::function<void(Scene&)>> changes{
        [&](Scene& s) { flip(s.lrhs.at(0, 0, 0)); },
        [&](Scene& s) { flip(s.lrhs.at(2, kHeight - 1, kWidth - 1)); },
        [&](Scene& s) { flip(s.hrls.at(1, bottom, 0)); },
        [&](Scene& s) { flip(s.hrls.at(2, 0, right)); },
        [&](Scene& s) { flip(s.lrhs.at(1, 7, 15)); },                // of a block's corner
        [&](Scene& s) { flip(s.hrls.at(5, 8, a.scale * 16 - 1)); },  // of a block's side
        [&](Scene& s) { s.hrls.at(0, 9, 30) = std::numeric_limits<float>::quiet_NaN(); },
        [&](Scene& s) {
          for (int c = 0; c < s.hrls.channels; ++c) std::fill_n(&s.hrls.at(c, 20, 100), 9, 50.0f);
        },
    };
    for (const FuserOptions& options : all_options()) {
      if (!is_tried(combinations++, 11)) continue;
      SCOPED_TRACE(fmt::format("x{}, {}", a.scale, describe(options)));
      Fuser whole = make(model, options, false), fuser = make(model, options);
      Scene scene = make_scene(a, 8);
      const auto expect_whole = [&](const Fused& fused) {
        const Fused expected = fuse(whole, scene);
        EXPECT_TRUE(same_bits(fused.image.data, expected.image.data));
        EXPECT_EQ(fused.report.status.saturated, expected.report.status.saturated);
        EXPECT_EQ(fused.report.settled_share, 0);
        EXPECT_EQ(expected.report.kept_share, 0);
      };
      const auto expect_all_computed = [&](const Fused& fused) {
        expect_whole(fused);
        EXPECT_EQ(fused.report.kept_share, 0);
        EXPECT_EQ(fused.report.work_share, 1);
      };
      expect_all_computed(fuse(fuser, scene));
      for (size_t i = 0; i < changes.size(); ++i) {
        SCOPED_TRACE(i);
        changes[i](scene);
        const Fused fused = fuse(fuser, scene);
        expect_whole(fused);
        EXPECT_GT(fused.report.kept_share, 0.2);
        EXPECT_LT(fused.report.kept_share, 1);
        EXPECT_LT(fused.report.work_share, 1);
      }
      const Fused same = fuse(fuser, scene);
      expect_whole(same);
      EXPECT_EQ(same.report.kept_share, 1);
      EXPECT_EQ(same.report.work_share, 0);
      EXPECT_EQ(same.report.device_ms, 0);
      scene = make_scene(a, 9);
      expect_all_computed(fuse(fuser, scene));
    }
  }
}

// By F(4, 3) a bright pixel changes how all of a tile is rounded, and that the tiles of the next layer. A
// change at each place of a block, so that one of them lies just within reach of another block.
TEST_F(ChangedTest, TheRoundingOfTilesIsWithinReach) {
  if (!gpu().info().buffer_device_address) GTEST_SKIP() << "direct kernels only";
  Architecture a = small_architecture(2);
  a.transfer = reference::Transfer::kLog;
  a.dense_layers = 3;
  const Model model = model_of(a);
  const FuserOptions options{.kernels = default_kernels(gpu().info())};
  Fuser fuser = make(model, options), whole = make(model, options, false);
  EXPECT_GT(fuser.graph().reach(), receptive_halo(model.architecture()));
  for (int x = 80; x < 80 + int(SparseGrid::kSide); ++x) {
    Scene scene = make_scene(a, 8);
    fuse_whole(fuser, scene);
    for (int c = 0; c < 3; ++c) {
      for (int y = 0; y < kHeight; ++y) scene.lrhs.at(c, y, x) = 90;
      for (int y = 0; y < 2 * kHeight; ++y) std::fill_n(&scene.hrls.at(c, y, 2 * x), 2, 90.0f);
    }
    const Fused fused = fuse(fuser, scene);
    EXPECT_GT(fused.report.kept_share, 0.2);
    EXPECT_TRUE(same_bits(fused.image.data, fuse(whole, scene).image.data)) << x;
  }
}

// Zero by either sign is the same to the network, and not to a comparison of bits.
TEST_F(ChangedTest, BitsAreComparedAndNotValues) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  Fuser fuser = make(model, {});
  Scene scene = make_scene(a, 8);
  scene.hrls.at(0, 0, 0) = 0.0f;
  const Image first = fuse(fuser, scene).image;
  scene.hrls.at(0, 0, 0) = -0.0f;
  const Fused fused = fuse(fuser, scene);
  EXPECT_LT(fused.report.kept_share, 1);
  EXPECT_EQ(fused.image.data, first.data);
}

// A change that a tile does not read leaves it out; one in the halo alone is seen.
TEST_F(ChangedTest, TilesThatDoNotChangeAreLeftOut) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  for (const FuserOptions& any : all_options()) {
    SCOPED_TRACE(describe(any));
    const FuserOptions options = tiled(model, any);
    Fuser fuser = make(model, options), whole = make(model, options), untiled = make(model, any, false);
    const Tiling tiling = fuser.plan().tiling;
    ASSERT_GT(tiling.columns, 1u);
    Scene scene = make_scene(a, 8);
    EXPECT_EQ(fuse(fuser, scene).report.kept_share, 0);
    const int seam = int(tiling.at(1).core_x), halo = int(tiling.halo);
    for (const int x : {0, seam - halo - 1, seam - halo, seam - 1, seam, seam + halo - 1, seam + halo}) {
      SCOPED_TRACE(x);
      scene.lrhs.at(1, 10, x) += 1;
      const Fused fused = fuse(fuser, scene);
      EXPECT_TRUE(same_bits(fused.image.data, fuse_whole(whole, scene).image.data));
      if (any.kernels.conv2d({8, 8, 4, 4, 3}).tile == 0) {
        EXPECT_TRUE(same_bits(fused.image.data, fuse(untiled, scene).image.data));
      }
      EXPECT_GT(fused.report.kept_share, 0);
      uint32_t reading = 0;
      for (uint32_t i = 0; i < tiling.count(); ++i) {
        const Tile at = tiling.at(i);
        reading += at.x <= uint32_t(x) && uint32_t(x) < at.x + tiling.tile.width && at.y <= 10 &&
                   10 < at.y + tiling.tile.height;
      }
      EXPECT_LE(fused.report.work_share, double(reading) / tiling.count());
    }
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
    EXPECT_EQ(cancelled.report.kept_share, 0);
    const auto fail = [](double share) -> bool {
      if (share > 0.5) throw Error("half of it is enough");
      return true;
    };
    EXPECT_ERROR(fuse(fuser, other, fail), "half of it");
    EXPECT_TRUE(same_bits(fuse(fuser, scene).image.data, expected.data));
    // Where nothing is computed, a frame can be cancelled too.
    EXPECT_THROW(fuse(fuser, scene, [](double) { return false; }), Cancelled);
    EXPECT_EQ(fuse(fuser, scene).report.kept_share, 0);
    EXPECT_EQ(fuse(fuser, scene).report.kept_share, 1);
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
    EXPECT_EQ(fused.report.kept_share, 0);
    EXPECT_TRUE(same_bits(fused.image.data, fuse(whole, scene, {}, exposure).image.data));
    EXPECT_EQ(fuse(fuser, scene, {}, exposure).report.kept_share, 1);
  }
}

// What is settled depends on the inputs as all else does.
TEST_F(ChangedTest, WhatChangedMayBeSettled) {
  const Architecture a = joint_architecture(2);
  const Model model = model_of(a);
  size_t combinations = 0;
  for (FuserOptions options : all_options()) {
    if (!is_tried(combinations++, 4)) continue;
    SCOPED_TRACE(describe(options));
    options.threshold = 1e-3f;
    Fuser whole = make(model, options, false), fuser = make(model, options);
    Scene scene = make_scene(a, 8);
    const auto settle = [&](int first, int last) {
      for (Image* image : {&scene.lrhs, &scene.hrls})
        for (int c = 0; c < 3; ++c)
          for (int y = 0, scale = image->width / kWidth; y < image->height; ++y)
            std::fill_n(&image->at(c, y, first * scale), (last - first) * scale, 0.25f);
    };
    settle(120, 160);
    EXPECT_TRUE(same_bits(fuse(fuser, scene).image.data, fuse(whole, scene).image.data));
    for (const int last : {30, 40}) {
      settle(10, last);
      const Fused fused = fuse(fuser, scene), expected = fuse(whole, scene);
      EXPECT_TRUE(same_bits(fused.image.data, expected.image.data)) << last;
      EXPECT_GT(fused.report.kept_share, 0.1);
      EXPECT_GT(fused.report.settled_share, 0);
      EXPECT_LT(fused.report.settled_share, expected.report.settled_share);
      EXPECT_LT(fused.report.work_share, expected.report.work_share);
    }
    EXPECT_EQ(fuse(fuser, scene).report.settled_share, 0);
  }
}

// A tile that 16 bits cannot hold is computed in 32 as a whole, whatever of it changed.
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
      light(170, 1e-6f);  // far away, and small
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

TEST_F(ChangedTest, WhoCannotKnowWhatChangedIsTold) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  Fuser fuser = make(model, {}), whole = make(model, {}, false),
        settling = make(model, {.threshold = 0.1f}, false);
  EXPECT_ERROR(fuser.record(VK_NULL_HANDLE, FrameBindings{}), "record()", "changed_only");
  EXPECT_ERROR(fuser.program().set_needed({true}), "1 blocks", "69");
  for (Fuser* other : {&whole, &settling})
    EXPECT_ERROR(other->program().set_needed({true}), "not for the host to tell");
}

}  // namespace
}  // namespace raymeld::test
