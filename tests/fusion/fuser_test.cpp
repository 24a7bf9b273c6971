#include "fusion/fuser.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cfloat>
#include <climits>
#include <cmath>
#include <limits>

#include "error_of.h"
#include "networks/network.h"
#include "subject.h"

namespace raymeld::test {
namespace {

using reference::Architecture;
using reference::Planes;
using reference::Precision;

class FuserTest : public GpuTest {
 protected:
  Model model_of(const Subject& subject, const std::string& exposure_key = "0") {
    return saved_model(folder_.path(), subject, {{"exposure_key", exposure_key}});
  }

  TemporaryDirectory folder_;
};

Fuser make_fuser(const Model& model, const Subject& subject, const FuserOptions& options) {
  return Fuser(gpu(), model, uint32_t(subject.lrhs.h), uint32_t(subject.lrhs.w), options,
               shared_cache_folder());
}

std::vector<float> fuse(Fuser& fuser, const Planes& lrhs, const Planes& hrls, const Progress& progress = {}) {
  Image fused;
  fuser.fuse(image_of(lrhs), image_of(hrls), fused, progress);
  return fused.data;
}

std::vector<float> fuse_once(const Model& model, const Subject& subject, const FuserOptions& options) {
  Fuser fuser = make_fuser(model, subject, options);
  return fuse(fuser, subject.lrhs, subject.hrls);
}

// Returns options under which a frame takes several tiles: half the memory that one tile needs.
FuserOptions tiled(const Model& model, const Subject& subject, FuserOptions options) {
  const FusePlan whole =
      plan_fusion(model, uint32_t(subject.lrhs.h), uint32_t(subject.lrhs.w), gpu().info(), options);
  options.max_memory_bytes =
      whole.graph.constant_bytes() + (whole.graph.activation_bytes() + whole.frame_bytes) / 2;
  return options;
}

TEST_F(FuserTest, FramesRepeatBitForBit) {
  const Subject subject = make_subject(small_architecture(4), 5, 7, 1);
  const Model model = model_of(subject);
  Fuser fuser = make_fuser(model, subject, {});
  const std::vector<float> first = fuse(fuser, subject.lrhs, subject.hrls);
  Planes other = subject.hrls;
  for (double& v : other.data) v = float(0.5 - v);
  EXPECT_NE(fuse(fuser, subject.lrhs, other), first);
  EXPECT_EQ(fuse(fuser, subject.lrhs, subject.hrls), first);
  EXPECT_EQ(fuse_once(model, subject, {}), first);
}

std::vector<Architecture> shapes() {
  std::vector<Architecture> all;
  for (const int scale : {2, 4, 8}) {
    all.push_back(small_architecture(scale));
    all.push_back(guided_architecture(scale));
    all.push_back(all.back());
    all.back().hrls_kernel = 1;
  }
  return all;
}

TEST_F(FuserTest, TiledAndUntiledGiveTheSameBits) {
  size_t combinations = 0;
  std::vector<Architecture> all = shapes();
  all.push_back(pyramid_architecture(1));
  all.push_back(kpcn_architecture());
  for (const int scale : {2, 4, 8}) {
    all.push_back(pyramid_architecture(scale));
    all.push_back(edsr_architecture(scale));
  }
  all.push_back(unshuffled_architecture(4));
  for (const Architecture& a : all) {
    const int scale = a.scale;
    const Size size = a.is_pyramid() ? Size{3, 19 + 640 / scale} : Size{27, 30};
    const Subject subject = make_subject(a, size.h, size.w, uint64_t(scale));
    const Model model = model_of(subject);
    for (const Precision precision : kPrecisions) {
      for (const bool centered : {false, true}) {
        if (!is_tried(combinations++, 3)) continue;
        SCOPED_TRACE(fmt::format("x{} guide {} pyramid {} {} centered {}", scale, a.hrls_guide,
                                 a.is_pyramid(), name_of(precision), centered));
        const FuserOptions options{.storage = storage_of(precision),
                                   .phase = lrhs_phase(centered, uint32_t(scale))};
        const FuserOptions limited = tiled(model, subject, options);
        Fuser fuser = make_fuser(model, subject, limited);
        EXPECT_GT(fuser.plan().tiling.count(), 1u);
        EXPECT_TRUE(same_bits(fuse(fuser, subject.lrhs, subject.hrls), fuse_once(model, subject, options)));
        EXPECT_LE(fuser.allocated_bytes(), limited.max_memory_bytes);
      }
    }
  }
}

// Holds how far the output responds to one lit pixel of HRLS or LRHS. All weights are positive and all biases
// zero, so that exactly the pixels that can depend on it are above zero.
struct Reach {
  int least, most;  // the rows or columns of blocks of s x s output pixels, relative to the lit block
};

Reach reach_of(const Fuser& fuser, const Planes& fused, int scale, int lit_cell, bool rows) {
  Reach reach{INT_MAX, INT_MIN};
  const int lrhs_pixels = int(rows ? fuser.plan().tiling.frame.height : fuser.plan().tiling.frame.width);
  for (int i = 0; i < lrhs_pixels * scale; ++i) {
    if (fused.at(0, rows ? i : 0, rows ? 0 : i) <= 0) continue;
    reach.least = std::min(reach.least, i / scale - lit_cell);
    reach.most = std::max(reach.most, i / scale - lit_cell);
  }
  return reach;
}

// A pixel of a wide frame changes outputs far away, but not beyond the halo, which is rounded up.
TEST_F(FuserTest, TheHaloOfAPyramidIsEnough) {
  for (const int scale : {1, 2, 4, 8}) {
    SCOPED_TRACE(fmt::format("x{}", scale));
    Subject subject = make_subject(pyramid_architecture(scale), 1, 1, 3);
    const Model model = model_of(subject);
    const int grid = int(model.architecture().grid()), halo = int(receptive_halo(model.architecture()));
    EXPECT_EQ(halo % grid, 0);
    int reached = 0;
    for (int offset = 0; offset < grid; ++offset) {  // where the pixel lies in a pixel of the coarsest level
      const int lit = 2 * halo + offset, width = 4 * halo + 1;
      subject.lrhs = random_planes(3, 1, width, Fill::kUniform, 1);
      subject.hrls = random_planes(9, scale, scale * width, Fill::kUniform, 2);
      Fuser fuser = make_fuser(model, subject, {});
      const std::vector<float> before = fuse(fuser, subject.lrhs, subject.hrls);
      for (int c = 0; c < 3; ++c) {
        subject.lrhs.at(c, 0, lit) = 50;
        subject.hrls.at(c, 0, scale * lit) = subject.hrls.at(c, 0, scale * lit + scale - 1) = 50;
      }
      const std::vector<float> after = fuse(fuser, subject.lrhs, subject.hrls);
      for (size_t i = 0; i < before.size(); ++i) {
        if (before[i] != after[i])
          reached = std::max(reached, std::abs(int(i) % (scale * width) / scale - lit));
      }
    }
    EXPECT_LE(reached, halo);
    EXPECT_GT(reached, halo - 2 * grid);
  }
}

// A lit pixel changes kernels far away. It is no firefly, and gradients look one way only, so that on each
// side the halo may be two pixels larger than what it reaches.
TEST_F(FuserTest, TheHaloOfKpcnIsEnoughAndNotTooLarge) {
  Subject subject = make_subject(kpcn_architecture(), 1, 1, 3);
  const Model model = model_of(subject);
  const int halo = int(receptive_halo(model.architecture())), lit = halo + 3, width = 2 * lit + 1;
  subject.hrls = random_planes(12, 1, width, Fill::kUniform, 2);
  subject.lrhs = slice(reference::exact(subject.hrls), 0, 3).value;
  Fuser fuser = make_fuser(model, subject, {});
  const std::vector<float> before = fuse(fuser, subject.lrhs, subject.hrls);
  for (int c = 0; c < 12; ++c) subject.hrls.at(c, 0, lit) = 1;
  const std::vector<float> after = fuse(fuser, subject.lrhs, subject.hrls);
  int reached = 0;
  for (int i = 0; i < 3 * width; ++i) {
    if (before[size_t(i)] != after[size_t(i)]) reached = std::max(reached, std::abs(i % width - lit));
  }
  EXPECT_LE(reached, halo);
  EXPECT_GE(reached, halo - 2);
}

TEST_F(FuserTest, TheHaloOfEdsrIsNeededAndEnough) {
  for (const int scale : {2, 4, 8}) {
    SCOPED_TRACE(fmt::format("x{}", scale));
    Subject subject = make_subject(edsr_architecture(scale), 1, 1, 1);
    for (auto& [name, conv] : subject.weights) {
      std::ranges::fill(conv.weight, 0.25);
      std::ranges::fill(conv.bias, 0);
    }
    const Model model = model_of(subject);
    const int halo = int(receptive_halo(model.architecture())), lit = halo + 2, width = 2 * lit + 1;
    subject.lrhs = Planes(3, 1, width);
    subject.lrhs.at(0, 0, lit) = 1;
    Fuser fuser = make_fuser(model, subject, {});
    const std::vector<float> fused = fuse(fuser, subject.lrhs, subject.hrls);
    const Reach reach = reach_of(fuser, planes(3, scale, scale * width, fused), scale, lit, false);
    EXPECT_EQ(reach.least, -halo);
    EXPECT_EQ(reach.most, halo);
  }
}

// Attention reads means over the whole frame, which no tile has.
TEST_F(FuserTest, RcanTakesAFrameOfOneTile) {
  const Subject subject = make_subject(rcan_architecture(2), 27, 30, 1);
  const Model model = model_of(subject);
  Planes other = subject.lrhs;
  for (int c = 0; c < 3; ++c) other.at(c, 26, 29) += 40;
  Fuser fuser = make_fuser(model, subject, {});
  EXPECT_EQ(fuser.plan().tiling.halo, 30u);
  const std::vector<float> fused = fuse(fuser, subject.lrhs, subject.hrls),
                           changed = fuse(fuser, other, subject.hrls);
  int differing = 0;  // in the first row
  for (int x = 0; x < 60; ++x) differing += fused[x] != changed[x];
  EXPECT_GT(differing, 10);
  const FuserOptions limited = tiled(model, subject, {});
  EXPECT_TRUE(contains(error_of([&] { plan_fusion(model, 27, 30, gpu().info(), limited); }),
                       "the frame, all of which its network needs at once, does not fit"));
}

TEST_F(FuserTest, TheHaloIsNeededAndEnough) {
  for (Architecture a : shapes()) {
    const int scale = a.scale;
    a.has_base = false;
    a.hrls_layers = {reference::LayerKind::kRadiance};
    a.features = 4;
    a.dense_layers = scale == 4 ? 2 : 1;
    a.groups = scale == 2 ? 2 : 1;
    Subject subject = make_subject(a, 1, 1, 1);
    for (auto& [name, conv] : subject.weights) {
      for (double& w : conv.weight) w = 0.25;
      for (double& b : conv.bias) b = 0;
    }
    const Model model = model_of(subject);
    const int halo = int(receptive_halo(model.architecture())), lit = halo + 2, length = 2 * lit + 1;
    for (const bool rows : {false, true}) {
      SCOPED_TRACE(fmt::format("x{}, guide {}, {}", scale, a.hrls_guide, rows ? "rows" : "columns"));
      const int h = rows ? length : 1, w = rows ? 1 : length;
      subject.lrhs = Planes(3, h, w);
      Fuser fuser = make_fuser(model, subject, {});
      Reach widest{0, 0};
      for (int pixel = lit * scale; pixel < (lit + 1) * scale; ++pixel) {
        Planes hrls(3, h * scale, w * scale);
        hrls.at(0, rows ? pixel : 0, rows ? 0 : pixel) = 1;
        const Planes fused = planes(3, h * scale, w * scale, fuse(fuser, subject.lrhs, hrls));
        const Reach reach = reach_of(fuser, fused, scale, lit, rows);
        widest = {std::min(widest.least, reach.least), std::max(widest.most, reach.most)};
      }
      if (a.hrls_kernel > 1) {  // LRHS may reach further than HRLS by a 1x1
        EXPECT_EQ(widest.least, -halo);
        EXPECT_EQ(widest.most, halo);
      }

      Planes lrhs(3, h, w);
      lrhs.at(0, rows ? lit : 0, rows ? 0 : lit) = 1;
      const Planes dark(3, h * scale, w * scale);
      const Reach low =
          reach_of(fuser, planes(3, h * scale, w * scale, fuse(fuser, lrhs, dark)), scale, lit, rows);
      EXPECT_GT(low.most, 0);
      EXPECT_EQ(std::min(low.least, widest.least), -halo);
      EXPECT_EQ(std::max(low.most, widest.most), halo);
    }
  }
}

// Powers of two scale without rounding: the exposed values are the same to the bit, and so is the output.
TEST_F(FuserTest, AKeyMakesTheOutputFollowTheBrightness) {
  Architecture a = guided_architecture(4);
  a.hrls_layers.push_back(reference::LayerKind::kVariance);
  Subject subject = make_subject(a, 27, 30, 13);
  for (double& v : subject.lrhs.data) v = std::abs(v);
  const Model model = model_of(subject, "0.2");
  for (const Precision precision : kPrecisions) {
    const FuserOptions options{.storage = storage_of(precision)};
    Fuser fuser = make_fuser(model, subject, tiled(model, subject, options));
    EXPECT_GT(fuser.plan().tiling.count(), 1u);
    const std::vector<float> plain = fuse(fuser, subject.lrhs, subject.hrls);
    EXPECT_TRUE(same_bits(fuse_once(model, subject, options), plain));
    for (const double scale : {0x1p-10, 0x1p-2, 0x1p10}) {
      SCOPED_TRACE(fmt::format("{}, {}", name_of(precision), scale));
      Planes lrhs = subject.lrhs, hrls = subject.hrls;
      for (double& v : lrhs.data) v *= scale;
      const size_t layer = hrls.data.size() / 4;  // the layers are color, albedo, normal and variance
      for (size_t i = 0; i < layer; ++i) {
        hrls.data[i] *= scale;
        hrls.data[3 * layer + i] *= scale * scale;
      }
      std::vector<float> expected = plain;
      for (float& v : expected) v = std::min(float(v * scale), 65504.0f);
      EXPECT_TRUE(same_bits(fuse(fuser, lrhs, hrls), expected));
    }
    FuserOptions off = options;
    off.exposure = 1;
    EXPECT_NE(fuse_once(model, subject, off), plain);
  }
}

TEST_F(FuserTest, ExposuresAreLimitedAndReported) {
  const Subject subject = make_subject(small_architecture(2), 3, 4, 6);
  const Model model = model_of(subject, "0.25");
  Fuser fuser = make_fuser(model, subject, {});
  const auto exposure_of_all = [&](float value) {
    Planes lrhs = subject.lrhs;
    std::ranges::fill(lrhs.data, double(value));
    Image fused;
    const FuseReport report = fuser.fuse(image_of(lrhs), image_of(subject.hrls), fused);
    for (const float v : fused.data) EXPECT_TRUE(std::isfinite(v) && v >= 0 && v <= 65504) << v;
    return report.exposure;
  };
  EXPECT_FLOAT_EQ(exposure_of_all(0.5f), 0.5f);
  EXPECT_FLOAT_EQ(exposure_of_all(1e30f), 0.25f / 65504);
  EXPECT_EQ(exposure_of_all(FLT_TRUE_MIN), 0x1p24f);
  for (const float black : {0.0f, -1.0f, std::numeric_limits<float>::quiet_NaN()}) {
    EXPECT_EQ(exposure_of_all(black), 1);
  }
  for (const float bad : {-1.0f, 0x1p-25f, 0x1p25f, std::numeric_limits<float>::quiet_NaN()}) {
    EXPECT_ERROR(make_fuser(model, subject, {.exposure = bad}), "exposure");
  }
}

TEST_F(FuserTest, BadPixelsStayWithinTheHaloAndGiveFiniteOutput) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  for (const Precision precision : kPrecisions) {
    const int scale = 4, h = 3, w = 20;
    const Subject subject = make_subject(small_architecture(scale), h, w, 5);
    const Model model = model_of(subject);
    const int halo = int(receptive_halo(model.architecture())), bad_column = w - 1;
    Fuser fuser = make_fuser(model, subject, {.storage = storage_of(precision)});
    const std::vector<float> clean = fuse(fuser, subject.lrhs, subject.hrls);
    for (const float bad : {kNaN, kInfinity, -kInfinity, 6e4f, 1e8f, 1e30f, FLT_MAX, -FLT_MAX}) {
      SCOPED_TRACE(fmt::format("{} in {}", bad, name_of(precision)));
      Planes lrhs = subject.lrhs, hrls = subject.hrls;
      for (int c = 0; c < lrhs.c; ++c) lrhs.at(c, 1, bad_column) = bad;
      for (int c = 0; c < hrls.c; ++c) hrls.at(c, 5, bad_column * scale) = bad;
      const std::vector<float> fused = fuse(fuser, lrhs, hrls);
      size_t far_changed = 0, not_finite = 0;
      for (size_t i = 0; i < fused.size(); ++i) {
        not_finite += !std::isfinite(fused[i]);
        const int column = int(i % size_t(w * scale)) / scale;
        far_changed += column < bad_column - halo && fused[i] != clean[i];
      }
      EXPECT_EQ(not_finite, 0u);
      EXPECT_EQ(far_changed, 0u);
      EXPECT_NE(fused, clean);
    }
  }
}

TEST_F(FuserTest, ImagesOfOneValueGiveFiniteOutput) {
  const Subject subject = make_subject(small_architecture(2), 3, 4, 6);
  const Model model = model_of(subject);
  for (const Precision precision : kPrecisions) {
    Fuser fuser = make_fuser(model, subject, {.storage = storage_of(precision)});
    for (const float value : special_values()) {
      Planes lrhs = subject.lrhs, hrls = subject.hrls;
      std::ranges::fill(lrhs.data, double(value));
      std::ranges::fill(hrls.data, double(value));
      for (const float v : fuse(fuser, lrhs, hrls)) {
        ASSERT_TRUE(std::isfinite(v) && v >= 0) << value << " gave " << v;
      }
    }
  }
}

TEST_F(FuserTest, AnOverflowInsideIsAnErrorOrCounted) {
  Subject subject = make_subject(small_architecture(2), 3, 4, 7);
  for (double& w : subject.weights.at("up.0").weight) w = std::copysign(1e30, w);
  for (double& w : subject.weights.at("fuse").weight) w = std::copysign(1e30, w);
  const Model huge = model_of(subject);
  Fuser fuser = make_fuser(huge, subject, {});
  EXPECT_ERROR(fuse(fuser, subject.lrhs, subject.hrls), "not finite", huge.name());

  subject = make_subject(small_architecture(2), 3, 4, 7);
  for (double& b : subject.weights.at("rec").bias) b = 1e5;
  const Model large = model_of(subject);
  Fuser half = make_fuser(large, subject, {.storage = Storage::kFloat16});
  Image fused;
  EXPECT_GT(half.fuse(image_of(subject.lrhs), image_of(subject.hrls), fused).status.saturated, 0u);
  subject.weights.at("rec").weight[5] = -65520;
  const Model wide = model_of(subject);
  EXPECT_ERROR(make_fuser(wide, subject, {.storage = Storage::kFloat16}), "layer rec", "-65520", "16 bits");
  EXPECT_NO_THROW(make_fuser(wide, subject, {}));

  const Model sane = model_of(make_subject(small_architecture(2), 3, 4, 7));
  Fuser quiet = make_fuser(sane, subject, {.storage = Storage::kFloat16});
  EXPECT_EQ(quiet.fuse(image_of(subject.lrhs), image_of(subject.hrls), fused).status.saturated, 0u);
}

TEST_F(FuserTest, TooLittleMemoryIsAnError) {
  const Subject subject = make_subject(small_architecture(2), 8, 8, 8);
  const Model model = model_of(subject);
  EXPECT_ERROR(make_fuser(model, subject, {.max_memory_bytes = 1000}), "smallest tile", "MiB");
  FuserOptions options = tiled(model, make_subject(small_architecture(2), 40, 40, 8), {});
  options.keep_activations = true;
  EXPECT_ERROR(plan_fusion(model, 40, 40, gpu().info(), options), "one tile");
}

TEST_F(FuserTest, PlansKeepTheLimitsOfTheDevice) {
  Architecture a = small_architecture(2);
  a.features = 64;
  const Model model = model_of(make_subject(a, 1, 1, 1));
  DeviceInfo device = gpu().info();
  device.memory_bytes = device.max_allocation_bytes = uint64_t{64} << 30;
  device.max_storage_range_bytes = uint64_t{4} << 30;
  EXPECT_EQ(plan_fusion(model, 540, 960, device, {}).tiling.count(), 1u);

  device.max_storage_range_bytes = uint64_t{128} << 20;  // a 1080p tensor of 64 floats takes 506 MiB
  const FusePlan ranged = plan_fusion(model, 540, 960, device, {});
  EXPECT_GT(ranged.tiling.count(), 4u);
  Graph graph(Storage::kFloat32);
  network(graph, model, ranged.tiling.tile.height, ranged.tiling.tile.width, 0);
  graph.plan();
  EXPECT_LE(graph.largest_binding_bytes(), device.max_storage_range_bytes);

  device.max_storage_range_bytes = uint64_t{4} << 30;
  device.max_allocation_bytes = uint64_t{300} << 20;
  const FusePlan allocated = plan_fusion(model, 540, 960, device, {});
  EXPECT_GT(allocated.tiling.count(), 1u);
  EXPECT_LE(allocated.graph.activation_bytes(), device.max_allocation_bytes);

  device.max_allocation_bytes = uint64_t{64} << 30;
  device.memory_bytes = uint64_t{500} << 20;
  const FusePlan small = plan_fusion(model, 540, 960, device, {});
  EXPECT_GT(small.tiling.count(), 1u);
  EXPECT_LE(small.peak_bytes(), device.memory_bytes);

  device.memory_bytes = uint64_t{64} << 30;
  device.max_groups = {65535, 100, 65535};  // a workgroup of above_clip covers two rows of LRHS
  const FusePlan grouped = plan_fusion(model, 540, 960, device, {});
  EXPECT_GT(grouped.tiling.count(), 1u);
  EXPECT_LE(grouped.tiling.tile.height, 200u);
  device.max_groups = {65535, 1, 65535};
  EXPECT_ERROR(plan_fusion(model, 540, 960, device, {}), model.name(), "workgroups along y");
}

TEST_F(FuserTest, AFrameTooLargeToAddressIsTiled) {
  const Model model = model_of(make_subject(small_architecture(2), 1, 1, 1));
  const FusePlan plan = plan_fusion(model, 65536, 65536, gpu().info(), {});
  EXPECT_GT(plan.tiling.count(), 1u);
  EXPECT_LE(plan.peak_bytes(), gpu().info().memory_bytes);
}

TEST_F(FuserTest, SplitDispatchesGiveTheSameBits) {
  const Subject subject = make_subject(small_architecture(4), 9, 11, 9);
  const Model model = model_of(subject);
  const std::vector<float> expected = fuse_once(model, subject, {});
  for (const double flop : {1.0, 3e4, 1e6}) {
    const WorkLimits limits{.dispatch_work = flop, .submit_work = 8 * flop};
    EXPECT_EQ(fuse_once(model, subject, {.work_limits = limits}), expected) << flop;
  }
}

TEST_F(FuserTest, ProgressRisesToOneAndCancels) {
  const Subject subject = make_subject(small_architecture(2), 27, 30, 10);
  const Model model = model_of(subject);
  const WorkLimits several_submits{.dispatch_work = 1e5, .submit_work = 8e5};
  Fuser fuser = make_fuser(model, subject, tiled(model, subject, {.work_limits = several_submits}));
  std::vector<double> shares;
  const std::vector<float> expected = fuse(fuser, subject.lrhs, subject.hrls, [&](double share) {
    shares.push_back(share);
    return true;
  });
  EXPECT_GT(shares.size(), fuser.plan().tiling.count());
  EXPECT_TRUE(std::ranges::is_sorted(shares, std::less_equal<>()));
  EXPECT_GT(shares.front(), 0);
  EXPECT_DOUBLE_EQ(shares.back(), 1);

  size_t calls = 0;
  EXPECT_THROW(fuse(fuser, subject.lrhs, subject.hrls, [&](double) { return ++calls < 2; }), Cancelled);
  EXPECT_EQ(calls, 2u);
  EXPECT_EQ(fuse(fuser, subject.lrhs, subject.hrls), expected);
}

TEST_F(FuserTest, ProfileHasEveryPass) {
  const Subject subject = make_subject(small_architecture(4), 9, 11, 11);
  const Model model = model_of(subject);
  Fuser fuser = make_fuser(model, subject, {.profile = true});
  Image fused;
  const FuseReport report = fuser.fuse(image_of(subject.lrhs), image_of(subject.hrls), fused);
  ASSERT_EQ(report.layers.size(), fuser.graph().passes().size());
  double time_ms = 0, flop = 0;
  for (size_t i = 0; i < report.layers.size(); ++i) {
    EXPECT_EQ(report.layers[i].name, fuser.graph().passes()[i].name);
    EXPECT_GE(report.layers[i].time_ms, 0);
    EXPECT_GT(report.layers[i].bytes, 0);
    time_ms += report.layers[i].time_ms;
    flop += report.layers[i].flop;
  }
  EXPECT_GT(time_ms, 0);
  EXPECT_LE(time_ms, report.device_ms);
  EXPECT_EQ(flop, fuser.plan().flop);
  double kernels_ms = 0, kernels_flop = 0;
  for (const PassTime& kernel : report.kernels) {
    kernels_ms += kernel.time_ms;
    kernels_flop += kernel.flop;
  }
  EXPECT_NEAR(kernels_ms, time_ms, 1e-9 * time_ms);
  EXPECT_EQ(kernels_flop, flop);
  EXPECT_LT(report.kernels.size(), report.layers.size());
  EXPECT_EQ(fused.data, fuse_once(model, subject, {}));
}

TEST_F(FuserTest, WrongSizesAreErrors) {
  const Subject subject = make_subject(small_architecture(2), 4, 5, 12);
  const Model model = model_of(subject);
  Fuser fuser = make_fuser(model, subject, {});
  EXPECT_ERROR(fuse(fuser, Planes(3, 5, 4), subject.hrls), "LRHS", "5x4");
  EXPECT_ERROR(fuse(fuser, subject.lrhs, Planes(9, 8, 8)), "HRLS", "10x8");
  EXPECT_ERROR(fuse(fuser, subject.lrhs, Planes(6, 8, 10)), "HRLS", "9");
}

TEST(FuserOptions, StorageFollowsTheRequestAndTheDevice) {
  DeviceInfo gpu_with, gpu_without, cpu;
  gpu_with.storage_16bit = true;
  cpu.is_cpu = cpu.storage_16bit = true;
  using raymeld::Precision;
  EXPECT_EQ(storage_for(Precision::kAuto, gpu_with), Storage::kFloat16);
  EXPECT_EQ(storage_for(Precision::kAuto, gpu_without), Storage::kFloat32);
  EXPECT_EQ(storage_for(Precision::kAuto, cpu), Storage::kFloat32);
  EXPECT_EQ(storage_for(Precision::kFp16, cpu), Storage::kFloat16);
  EXPECT_EQ(storage_for(Precision::kFp32, gpu_with), Storage::kFloat32);
}

TEST(FuserOptions, PhaseOfCentredSamples) {
  EXPECT_EQ(lrhs_phase(false, 8), 0);
  EXPECT_EQ(lrhs_phase(true, 2), 0.5f);
  EXPECT_EQ(lrhs_phase(true, 8), 3.5f);
}

}  // namespace
}  // namespace raymeld::test
