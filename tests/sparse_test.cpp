// What a frame does not need is not computed, and what it needs is the same bits as ever.
#include <gtest/gtest.h>

#include <cmath>

#include "error_of.h"
#include "fuser.h"
#include "fuser_options.h"
#include "network.h"
#include "settled.h"
#include "subject.h"

namespace raymeld::test {
namespace {

using reference::Architecture;
using reference::Planes;

constexpr int kHeight = 21, kWidth = 132, kSide = int(SparseGrid::kSide);

// Noise, but where both renders have one color: from `first` to `last` of LRHS's columns.
struct Scene {
  Image lrhs, hrls;
};

Scene make_scene(const Architecture& a, int first, int last, uint32_t seed) {
  const Subject subject = make_subject(a, kHeight, kWidth, seed);
  Scene scene{image_of(subject.lrhs), image_of(subject.hrls)};
  for (Image* image : {&scene.lrhs, &scene.hrls}) {
    const int scale = image == &scene.hrls ? a.scale : 1;
    for (int c = 0; c < 3; ++c)
      for (int y = 0; y < image->height; ++y)
        for (int x = first * scale; x < last * scale; ++x) image->at(c, y, x) = 0.25f * float(c + 1);
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

  Fused fuse_once(const Model& model, const Scene& scene, const FuserOptions& options) {
    Fuser fuser = make(model, options);
    return fuse(fuser, scene);
  }

  TemporaryDirectory folder_;
};

// LRHS columns of blocks that are settled, where those of [first, last) agree: a block reads one more column
// on each side.
bool is_settled(int x, int first, int last) {
  const int block = x / kSide * kSide;
  return block >= first && std::min(block + kSide, kWidth) + 1 <= last;
}

// The values of blocks that are needed, or of those that are not.
std::vector<float> values_of(const Image& image, int scale, int first, int last, bool settled) {
  std::vector<float> values;
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x < image.width; ++x)
        if (is_settled(x / scale, first, last) == settled) values.push_back(image.at(c, y, x));
  return values;
}

TEST_F(SparseTest, NeededBlocksHaveTheSameBits) {
  for (const Architecture& a : {joint_architecture(2), small_architecture(4)}) {
    const Model model = model_of(a);
    const Scene other = make_scene(a, 0, 0, 7), scene = make_scene(a, 8, 110, 8);
    for (FuserOptions options : all_options()) {
      SCOPED_TRACE(fmt::format("x{}, {}", a.scale, describe(options)));
      const Image dense = fuse_once(model, scene, options).image;
      options.threshold = 1e-3f;
      Fuser fuser = make(model, options);
      fuse(fuser, other);  // leaves its values where the next frame computes nothing
      const Fused sparse = fuse(fuser, scene);
      EXPECT_TRUE(same_bits(values_of(sparse.image, a.scale, 8, 110, false),
                            values_of(dense, a.scale, 8, 110, false)));
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
            if (!is_settled(x / a.scale, 8, 110)) continue;
            ASSERT_NEAR(image.at(c, y, x), 0.25 * (c + 1), 2e-3) << c << " " << y << " " << x;
          }
        }
      }
    }
  }
}

TEST_F(SparseTest, WhereNothingAgreesAllIsComputed) {
  const Architecture a = joint_architecture(2);
  const Model model = model_of(a);
  const Scene scene = make_scene(a, 0, 0, 9);
  for (FuserOptions options : all_options()) {
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
  const Fused sparse = fuse_once(model, make_scene(a, 0, kWidth, 9), {.threshold = 1e-3f});
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
  Scene scene = make_scene(a, 0, kWidth, 9);
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
  const Scene scene = make_scene(a, 8, 110, 11);
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
  options.threshold = 0;
  const Image dense = fuse_once(model, scene, options).image;
  for (const int x : {0, 3, kWidth - 4, kWidth - 1})
    EXPECT_EQ(tiles.image.at(0, 5, 2 * x), dense.at(0, 5, 2 * x));
}

TEST_F(SparseTest, ARecordedFrameDecidesOnTheDevice) {
  const Architecture a = small_architecture(2);
  const Model model = model_of(a);
  const FuserOptions options{.threshold = 1e-3f};
  Fuser fuser = make(model, options);
  for (const int last : {0, 110, 40}) {
    const Scene scene = make_scene(a, 8, last, 12);
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
