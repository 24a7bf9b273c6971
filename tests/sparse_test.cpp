// What a frame does not need is not computed, and what it needs is the same bits as ever.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>

#include "error_of.h"
#include "fuser.h"
#include "fuser_options.h"
#include "network.h"
#include "settled.h"
#include "subject.h"
#include "tuner.h"

namespace raymeld::test {
namespace {

using reference::Architecture;
using reference::Planes;

constexpr int kHeight = 21, kWidth = 132, kSide = int(SparseGrid::kSide);

// Whether both renders have one color at a pixel of LRHS.
using Region = std::function<bool(int y, int x)>;

Region columns(int first, int last) {
  return [=](int, int x) { return x >= first && x < last; };
}

// Noise, but in a region.
struct Scene {
  Image lrhs, hrls;
};

Scene make_scene(const Architecture& a, const Region& agrees, uint32_t seed, int height = kHeight,
                 int width = kWidth) {
  const Subject subject = make_subject(a, height, width, seed);
  Scene scene{image_of(subject.lrhs), image_of(subject.hrls)};
  for (Image* image : {&scene.lrhs, &scene.hrls}) {
    const int scale = image == &scene.hrls ? a.scale : 1;
    for (int c = 0; c < 3; ++c)
      for (int y = 0; y < image->height; ++y)
        for (int x = 0; x < image->width; ++x)
          if (agrees(y / scale, x / scale)) image->at(c, y, x) = 0.25f * float(c + 1);
  }
  return scene;
}

class SparseTest : public GpuTest {
 protected:
  Model model_of(const Architecture& a) {
    const Subject subject = make_subject(a, 2, 2, 5);
    write_model(folder_ / "model.safetensors", a, subject.weights);
    return Model(folder_ / "model.safetensors");
  }

  struct Fused {
    Image image;
    FuseReport report;
  };

  Fused fuse(Fuser& fuser, const Scene& scene) {
    Fused fused;
    fused.report = fuser.fuse(scene.lrhs, scene.hrls, fused.image);
    return fused;
  }

  Fuser make(const Model& model, const FuserOptions& options) {
    return Fuser(gpu(), model, kHeight, kWidth, options, shared_cache_folder());
  }

  Image dense_of(const Model& model, const Scene& scene) { return fuse_once(model, scene, {}).image; }

  Fused fuse_once(const Model& model, const Scene& scene, const FuserOptions& options) {
    Fuser fuser = make(model, options);
    return fuse(fuser, scene);
  }

  TemporaryDirectory folder_;
};

// Of the block in which a pixel of LRHS lies. Upsampling it reads one more pixel to the right and below.
bool is_settled(int y, int x, const Region& agrees, const Image& lrhs) {
  const int top = y / kSide * kSide, left = x / kSide * kSide;
  for (int v = top; v <= std::min(top + kSide, lrhs.height - 1); ++v)
    for (int u = left; u <= std::min(left + kSide, lrhs.width - 1); ++u)
      if (!agrees(v, u)) return false;
  return true;
}

// The values of blocks that are needed.
std::vector<float> needed_values(const Image& image, int scale, const Region& agrees, const Image& lrhs) {
  std::vector<float> values;
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x < image.width; ++x)
        if (!is_settled(y / scale, x / scale, agrees, lrhs)) values.push_back(image.at(c, y, x));
  return values;
}

TEST_F(SparseTest, NeededBlocksHaveTheSameBits) {
  size_t combinations = 0;
  for (const Architecture& a : {joint_architecture(2), small_architecture(4), cells_architecture(2)}) {
    const Model model = model_of(a);
    const Region agrees = columns(8, 110);
    const Scene other = make_scene(a, columns(0, 0), 7), scene = make_scene(a, agrees, 8);
    for (FuserOptions options : all_options()) {
      if (!is_tried(combinations++, 3)) continue;
      SCOPED_TRACE(fmt::format("x{}, {}", a.scale, describe(options)));
      const Image dense = fuse_once(model, scene, options).image;
      options.threshold = 1e-3f;
      Fuser fuser = make(model, options);
      fuse(fuser, other);  // leaves its values where the next frame computes nothing
      const Fused sparse = fuse(fuser, scene);
      EXPECT_TRUE(same_bits(needed_values(sparse.image, a.scale, agrees, scene.lrhs),
                            needed_values(dense, a.scale, agrees, scene.lrhs)));
      EXPECT_FALSE(same_bits(sparse.image.data, dense.data));
      EXPECT_DOUBLE_EQ(sparse.report.settled_share, 12.0 / 17);
      EXPECT_DOUBLE_EQ(settled_share(model.architecture(), scene.lrhs.data.data(), scene.hrls.data.data(),
                                     {kHeight, kWidth}, 0, 1, 1e-3f),
                       12.0 / 17);
      EXPECT_LT(sparse.report.work_share, 1);
      EXPECT_EQ(sparse.report.status.saturated, 0u);
      const Image image = sparse.image;
      for (int c = 0; c < 3; ++c) {
        for (int y = 0; y < image.height; ++y) {
          for (int x = 0; x < image.width; ++x) {
            if (!is_settled(y / a.scale, x / a.scale, agrees, scene.lrhs)) continue;
            ASSERT_NEAR(image.at(c, y, x), 0.25 * (c + 1), 2e-3) << c << " " << y << " " << x;
          }
        }
      }
    }
  }
}

// Rows of blocks have lists of any length, none among them; convolutions take turns by such rows.
TEST_F(SparseTest, RowsOfBlocksDiffer) {
  constexpr int kTall = 77, kWide = 61;
  const Architecture a = joint_architecture(2);
  const Model model = model_of(a);
  const std::array<Region, 4> regions{
      [](int y, int) { return y < 50; },
      [](int y, int) { return y >= 15 && y < 62; },
      [](int y, int x) { return x + y > 40 && x + y < 120; },
      [](int y, int x) { return y < 8 || y >= 16 || x >= 8; },
  };
  size_t combinations = 0;
  for (FuserOptions options : all_options()) {
    if (!is_tried(combinations++, 4)) continue;
    SCOPED_TRACE(describe(options));
    Fuser dense(gpu(), model, kTall, kWide, options, shared_cache_folder());
    options.threshold = 1e-3f;
    Fuser sparse(gpu(), model, kTall, kWide, options, shared_cache_folder());
    for (const Region& agrees : regions) {
      SCOPED_TRACE(&agrees - regions.data());
      const Scene scene = make_scene(a, agrees, 13, kTall, kWide);
      const Fused fused = fuse(sparse, scene);
      EXPECT_GT(fused.report.settled_share, 0.3);
      EXPECT_LT(fused.report.work_share, 1);
      EXPECT_TRUE(same_bits(needed_values(fused.image, a.scale, agrees, scene.lrhs),
                            needed_values(fuse(dense, scene).image, a.scale, agrees, scene.lrhs)));
    }
  }
}

// Rows of a chain of convolutions are kept as in a dense graph, not whole images.
TEST_F(SparseTest, TakesLittleMoreMemory) {
  if (!gpu().info().buffer_device_address) GTEST_SKIP() << "the device has direct kernels only";
  Architecture a = small_architecture(4);
  a.features = 16;
  const Model model = model_of(a);
  FuserOptions options{.kernels = default_kernels(gpu().info())};
  const auto bytes = [&] {
    return plan_fusion(model, 256, 256, gpu().info(), options).graph.activation_bytes();
  };
  const uint64_t dense = bytes();
  options.threshold = 1e-3f;
  EXPECT_LE(double(bytes()), 1.5 * double(dense));  // whole images would be 2.7
}

TEST_F(SparseTest, WhereNothingAgreesAllIsComputed) {
  const Architecture a = joint_architecture(2);
  const Model model = model_of(a);
  const Scene scene = make_scene(a, columns(0, 0), 9);
  size_t combinations = 0;
  for (FuserOptions options : all_options()) {
    if (!is_tried(combinations++, 4)) continue;
    SCOPED_TRACE(describe(options));
    const Image dense = fuse_once(model, scene, options).image;
    options.threshold = 1e-3f;
    const Fused sparse = fuse_once(model, scene, options);
    EXPECT_TRUE(same_bits(sparse.image.data, dense.data));
    EXPECT_EQ(sparse.report.settled_share, 0);
    EXPECT_EQ(sparse.report.work_share, 1);
  }
}

TEST_F(SparseTest, WhereAllAgreesNothingIsComputed) {
  const Architecture a = joint_architecture(2);
  const Model model = model_of(a);
  const Fused sparse = fuse_once(model, make_scene(a, columns(0, kWidth), 9), {.threshold = 1e-3f});
  EXPECT_EQ(sparse.report.settled_share, 1);
  EXPECT_LT(sparse.report.work_share, 0.1);
  for (int x = 0; x < sparse.image.width; ++x) EXPECT_NEAR(sparse.image.at(1, 3, x), 0.5, 1e-6);
}

// What agrees is nearer to both renders than half the threshold, as the network sees them.
TEST_F(SparseTest, SettledPixelsAreWithinHalfTheThreshold) {
  Architecture a = joint_architecture(2);
  a.transfer = reference::Transfer::kLinear;
  const Model model = model_of(a);
  const float threshold = 0.125f;
  Scene scene = make_scene(a, columns(0, kWidth), 9);
  const Planes noise =
      reference::random_planes(3, scene.hrls.height, scene.hrls.width, reference::Fill::kUniform, 10);
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < scene.hrls.height; ++y)
      for (int x = 0; x < scene.hrls.width; ++x)
        scene.hrls.at(c, y, x) += float(noise.at(c, y, x)) * (x < 100 ? 0.99f : 1.5f) * threshold;
  const Fused sparse = fuse_once(model, scene, {.threshold = threshold});
  EXPECT_GT(sparse.report.settled_share, 0.3);
  EXPECT_LT(sparse.report.settled_share, 0.5);
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < scene.hrls.height; ++y)
      for (int x = 0; x < 96; ++x) {
        EXPECT_LE(std::abs(sparse.image.at(c, y, x) - scene.hrls.at(c, y, x)), threshold / 2 + 1e-6);
        EXPECT_LE(std::abs(sparse.image.at(c, y, x) - 0.25f * float(c + 1)), threshold / 2 + 1e-6);
      }
}

TEST_F(SparseTest, TilesAndSplitsDecideForThemselves) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  const Scene scene = make_scene(a, columns(8, 110), 11);
  FuserOptions options{.threshold = 1e-3f};
  const Fused whole = fuse_once(model, scene, options);
  for (const WorkLimits& limits : {WorkLimits{1e12, 1e12}, {1e5, 1e6}, {1e3, 1e12}}) {
    options.work_limits = limits;
    const Fused split = fuse_once(model, scene, options);
    EXPECT_TRUE(same_bits(split.image.data, whole.image.data));
    EXPECT_EQ(split.report.settled_share, whole.report.settled_share);
  }
  options = {.max_memory_bytes = plan_fusion(model, kHeight, kWidth, gpu().info(), options).peak_bytes() / 2,
             .threshold = 1e-3f};
  Fuser tiled = make(model, options);
  const Fused tiles = fuse(tiled, scene);
  EXPECT_GT(tiled.plan().tiling.count(), 1u);
  EXPECT_GT(tiles.report.settled_share, 0.4);
  const Image dense = dense_of(model, scene);
  // What does not agree has the bits of one dense tile, whose kernels are direct ones.
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < dense.height; ++y)
      for (int x = 0; x < dense.width; ++x)
        if (x < 2 * 8 || x >= 2 * 110) {
          ASSERT_EQ(tiles.image.at(c, y, x), dense.at(c, y, x)) << c << " " << y << " " << x;
        }
  // Of what a tile reads around its core nothing is to be known: less is computed.
  const auto [height, width] = tiled.plan().tiling.tile;
  const Scene none = make_scene(
      a, [](int, int) { return false; }, 11);
  const Fused needed = fuse(tiled, none);
  EXPECT_LT(needed.report.work_share, 1);
  EXPECT_EQ(needed.image.data, dense_of(model, none).data);

  // A recorded tile is kept as a whole, whatever fuse() did before.
  const Scene part = make_scene(a, columns(8, 20), 12, int(height), int(width));
  const FrameImage lrhs(gpu(), planes_of(part.lrhs)), hrls(gpu(), planes_of(part.hrls));
  FrameImage fused(gpu(), Shape{a.scale * height, a.scale * width, 3}, FrameImage::Layout{});
  Commands pool(gpu());
  const VkCommandBuffer commands = pool.begin("tile");
  tiled.record(commands, lrhs.view(), hrls.view(), fused.view());
  pool.end(commands);
  gpu().submit_and_wait(commands);
  Fuser alone(gpu(), model, height, width, {.threshold = 1e-3f}, shared_cache_folder());
  Image expected;
  alone.fuse(part.lrhs, part.hrls, expected);
  EXPECT_EQ(fused.read().data, planes_of(expected).data);
}

TEST_F(SparseTest, ARecordedFrameDecidesOnTheDevice) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  const FuserOptions options{.threshold = 1e-3f};
  Fuser fuser = make(model, options);
  for (const int last : {0, 110, 40}) {
    const Scene scene = make_scene(a, columns(8, last), 12);
    const FrameImage lrhs(gpu(), planes_of(scene.lrhs)), hrls(gpu(), planes_of(scene.hrls));
    FrameImage fused(gpu(), Shape{uint32_t(a.scale * kHeight), uint32_t(a.scale * kWidth), 3},
                     FrameImage::Layout{});
    Commands pool(gpu());
    const VkCommandBuffer commands = pool.begin("frame");
    fuser.record(commands, lrhs.view(), hrls.view(), fused.view());
    pool.end(commands);
    gpu().submit_and_wait(commands);
    EXPECT_EQ(fused.read().data, planes_of(fuse_once(model, scene, options).image).data) << last;
  }
}

}  // namespace
}  // namespace raymeld::test
