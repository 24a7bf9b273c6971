// Tests the variance of HRLS that the device computes: it acts as a variance that is fed, also in tiles and
// where only parts of the frame changed.
#include <gtest/gtest.h>

#include "fusion/fuser.h"
#include "subject.h"

namespace raymeld::test {
namespace {

using reference::LayerKind;
using reference::Planes;
using reference::Precision;

reference::Architecture with_variance(reference::Architecture architecture) {
  architecture.hrls_layers.push_back(LayerKind::kVariance);
  return architecture;
}

std::vector<float> fuse(const Model& model, const Image& lrhs, const Image& hrls,
                        const FuserOptions& options) {
  Fuser fuser(gpu(), model, uint32_t(lrhs.height), uint32_t(lrhs.width), options, shared_cache_folder());
  Image fused;
  fuser.fuse(lrhs, hrls, fused);
  return fused.data;
}

double difference(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += std::abs(double(a[i]) - double(b[i]));
  return sum;
}

class VarianceTest : public GpuTest {
 protected:
  // Holds a model whose last HRLS layer is variance, and HRLS without it, with it, and with zeros for it.
  struct Inputs {
    Model model;
    Image lrhs, without, with, with_none;
  };
  Inputs inputs(const reference::Architecture& architecture, int height, int width) {
    const Subject subject = make_subject(with_variance(architecture), height, width, 7);
    const std::filesystem::path file = folder_ / "model.safetensors";
    write_model(file, subject.architecture, subject.weights);
    Inputs made{Model(file), image_of(subject.lrhs), image_of(subject.hrls), image_of(subject.hrls),
                image_of(subject.hrls)};
    const size_t others = made.with.data.size() - 3 * made.with.plane_size();
    Image color(made.with.width, made.with.height, 3);
    std::copy_n(made.with.data.begin(), color.data.size(), color.data.begin());
    std::ranges::copy(variance_3x3(color).data, made.with.data.begin() + ptrdiff_t(others));
    std::fill(made.with_none.data.begin() + ptrdiff_t(others), made.with_none.data.end(), 0.0f);
    made.without.channels -= 3;
    made.without.data.resize(others);
    return made;
  }

  TemporaryDirectory folder_;
};

// The host computes the variance in 64 bits. This moves the output far less than the variance itself does.
TEST_F(VarianceTest, IsWhatFeedingItGives) {
  for (const auto& architecture : {small_architecture(2), guided_architecture(4), pyramid_architecture(2)}) {
    const Inputs in = inputs(architecture, 6, 9);
    const std::vector<float> fed = fuse(in.model, in.lrhs, in.with, {});
    const std::vector<float> computed = fuse(in.model, in.lrhs, in.without, {.compute_variance = true});
    const double effect = difference(fuse(in.model, in.lrhs, in.with_none, {}), fed);
    EXPECT_GT(effect, 0);
    EXPECT_LT(difference(computed, fed), 1e-3 * effect);
  }
}

TEST_F(VarianceTest, TiledAndUntiledGiveTheSameBits) {
  const Inputs in = inputs(small_architecture(2), 27, 30);
  for (const Precision precision : kPrecisions) {
    FuserOptions options{.storage = storage_of(precision), .compute_variance = true};
    const std::vector<float> whole = fuse(in.model, in.lrhs, in.without, options);
    const FusePlan plan = plan_fusion(in.model, 27, 30, gpu().info(), options);
    options.max_memory_bytes =
        plan.graph.constant_bytes() + (plan.graph.activation_bytes() + plan.frame_bytes) / 2;
    EXPECT_GT(plan_fusion(in.model, 27, 30, gpu().info(), options).tiling.count(), 1u);
    EXPECT_TRUE(same_bits(fuse(in.model, in.lrhs, in.without, options), whole));
  }
}

// A tile also depends on the pixels outside it that the variance at its border reads.
TEST_F(VarianceTest, WhatChangedHasTheBitsOfAWholeFrame) {
  const reference::Architecture architecture = small_architecture(2);
  Inputs in = inputs(architecture, 40, 40);
  FuserOptions options{.skip_unchanged = true, .compute_variance = true, .exposure = 1};
  options.max_memory_bytes = plan_fusion(in.model, 40, 40, gpu().info(), options).peak_bytes() / 2;
  Fuser fuser(gpu(), in.model, 40, 40, options, shared_cache_folder());
  const Tiling tiling = fuser.plan().tiling;
  ASSERT_GT(tiling.count(), 1u);
  Image fused;
  fuser.fuse(in.lrhs, in.without, fused);
  const int seam = 2 * int(tiling.rows > 1 ? tiling.at(tiling.columns).y : tiling.at(1).x);
  for (const int at : {0, seam - 1, seam, seam + 1}) {
    in.without.at(1, at, at) += 3;
    fuser.fuse(in.lrhs, in.without, fused);
    EXPECT_TRUE(same_bits(fused.data,
                          fuse(in.model, in.lrhs, in.without, {.compute_variance = true, .exposure = 1})));
  }
}

TEST_F(VarianceTest, IsNotReadOfTheFrame) {
  const Inputs in = inputs(small_architecture(2), 6, 9);
  EXPECT_EQ(frame_shapes(in.model, {6, 9})[1].channels, 12u);
  EXPECT_EQ(frame_shapes(in.model, {6, 9}, {}, true)[1].channels, 9u);
  EXPECT_EQ(frame_shapes(in.model, {6, 9}, {{"variance", {}}}, true)[1].channels, 9u);
  EXPECT_EQ(image_layers(in.model.architecture(), {}, true),
            (std::vector<std::string>{"color", "albedo", "normal"}));
}

}  // namespace
}  // namespace raymeld::test
