// Tests that constant layers of HRLS give the same image as if they were fed.
#include "networks/constant_layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "error_of.h"
#include "networks/network.h"
#include "subject.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Architecture;
using reference::Bounded;
using reference::LayerKind;
using reference::Outputs;
using reference::Planes;
using reference::Precision;

// Adds diffuse and variance to color, albedo and normal: HRLS then has all layers that can be constant.
Architecture with_all_kinds(Architecture a) {
  a.hrls_layers.insert(a.hrls_layers.end(), {LayerKind::kRadiance, LayerKind::kVariance});
  return a;
}

Architecture kpcn_with_variance() {
  Architecture a = kpcn_architecture();
  a.hrls_layers.push_back(LayerKind::kVariance);
  return a;
}

std::vector<Architecture> architectures() {
  return {with_all_kinds(small_architecture(2)), with_all_kinds(guided_architecture(4)),
          with_all_kinds(unshuffled_architecture(2)), with_all_kinds(pyramid_architecture(2)),
          kpcn_with_variance()};
}

const ConstantLayers kAbsent{{"albedo", {}}, {"diffuse", {}}};
const ConstantLayers kConstant{{"albedo", {0.25f, 0.7f, 1}}, {"normal", {-0.3f, 0, 0.95f}}, {"variance", {}}};

// Holds HRLS with the constant layers as images of one value, and HRLS without them.
struct Constants {
  Planes fed, without;
};
Constants feed(const Architecture& a, Planes hrls, const ConstantLayers& constants) {
  const std::vector<std::string> layers{"color", "albedo", "normal", "diffuse", "variance"};
  EXPECT_EQ(layers.size(), a.hrls_layers.size());
  Planes without(0, hrls.h, hrls.w);
  const auto plane = ptrdiff_t(hrls.h) * hrls.w;
  for (int c = 0; c < hrls.c; ++c) {
    const auto first = hrls.data.begin() + c * plane;
    if (const auto constant = constants.find(layers[size_t(c / 3)]); constant != constants.end()) {
      std::fill_n(first, plane, constant->second[size_t(c % 3)]);
    } else {
      without.data.insert(without.data.end(), first, first + plane);
      ++without.c;
    }
  }
  return {std::move(hrls), std::move(without)};
}

FuserOptions options_without(const ConstantLayers& constants, Storage storage = Storage::kFloat32) {
  FuserOptions options;
  options.storage = storage;
  options.constants = constants;
  return options;
}

class ConstantLayersTest : public GpuTest {
 protected:
  Model model_of(const Subject& subject) { return saved_model(folder_.path(), subject); }

  TemporaryDirectory folder_;
};

std::vector<float> fuse(const Model& model, const Planes& lrhs, const Planes& hrls,
                        const FuserOptions& options) {
  Fuser fuser(gpu(), model, uint32_t(lrhs.h), uint32_t(lrhs.w), options, shared_cache_folder());
  Image fused;
  fuser.fuse(image_of(lrhs), image_of(hrls), fused);
  return fused.data;
}

// Compares each layer with the reference, which is fed the constant layers.
TEST_F(ConstantLayersTest, AreWithinTheBoundsOfFeedingThem) {
  uint64_t seed = 1;
  size_t combinations = 0;
  for (const Architecture& a : architectures()) {
    const Size size = std::vector<Size>{{1, 1}, {1, 7}, {5, 3}}[seed % 3];
    const Subject subject = make_subject(a, size.h, size.w, seed++);
    const Model model = model_of(subject);
    for (const ConstantLayers& constants : {kAbsent, kConstant}) {
      const auto both = feed(a, subject.hrls, constants);
      const Planes &fed = both.fed, &without = both.without;
      conform::Collector::for_each(
          conform::network_methods(gpu().info(), seed),
          [&](const conform::Method& method, Precision precision) {
            if (method.kernel.algorithm == Algorithm::kMatrix && !gpu().info().cooperative_matrix) return;
            if (!is_tried(combinations++, 5)) return;
            SCOPED_TRACE(fmt::format("x{} {} {}, {} constant", a.scale, method.name, name_of(precision),
                                     constants.size()));
            FuserOptions options = options_without(constants, storage_of(precision));
            options.kernels = conform::kernels_of(method);
            options.exposure = 1.7f;
            Subject pruned = subject;
            pruned.hrls = without;
            conform::NetworkRun run = conform::run_network(target(), model, pruned, options);
            // More constants than a pass takes are encoded in two, of which the last is kept.
            if (const int channels = fed.c + (a.is_pyramid() ? 3 : 0);
                run.layers.at("encode.hrls").c != channels)
              run.layers.erase("encode.hrls");
            reference::Weights weights;
            for (const auto& [name, conv] : subject.weights) weights[name] = round_to(conv, precision);
            const Outputs expected =
                reference::network(a, weights, subject.lrhs, fed, 0, precision, run.layers, options.exposure,
                                   method.tile(), method.units(precision));
            for (const auto& [layer, values] : run.layers)
              EXPECT_TRUE(within_bounds(layer, values, expected.at(layer)));
            EXPECT_TRUE(within_bounds("output", run.output, expected.at("output")));
          });
    }
  }
}

TEST_F(ConstantLayersTest, TiledAndUntiledGiveTheSameBits) {
  for (Architecture a : architectures()) {
    const Size size = a.is_pyramid() ? Size{5, 360} : Size{27, 30};
    const Subject subject = make_subject(a, size.h, size.w, 4);
    const Model model = model_of(subject);
    const Planes hrls = feed(a, subject.hrls, kConstant).without;
    for (const Precision precision : kPrecisions) {
      FuserOptions options = options_without(kConstant, storage_of(precision));
      const std::vector<float> whole = fuse(model, subject.lrhs, hrls, options);
      const FusePlan plan = plan_fusion(model, uint32_t(size.h), uint32_t(size.w), gpu().info(), options);
      options.max_memory_bytes =
          plan.graph.constant_bytes() + (plan.graph.activation_bytes() + plan.frame_bytes) / 2;
      EXPECT_GT(plan_fusion(model, uint32_t(size.h), uint32_t(size.w), gpu().info(), options).tiling.count(),
                1u);
      EXPECT_TRUE(same_bits(fuse(model, subject.lrhs, hrls, options), whole));
    }
  }
}

// The exponents of 16-bit storage stay the same.
TEST_F(ConstantLayersTest, FollowTheExponentsOfStorage) {
  const Architecture a = with_all_kinds(guided_architecture(2));
  Subject subject = make_subject(a, 9, 5, 5);
  for (double& w : subject.weights.at("hrls").weight) w = float(w * 3e4);
  for (double& w : subject.weights.at("fuse").weight) w = float(w * 1e-4);
  const Model model = model_of(subject);
  EXPECT_GT(storage_exponents(model).at("hrls"), 0);
  const auto [fed, without] = feed(a, subject.hrls, kConstant);
  const std::vector<float> expected = fuse(model, subject.lrhs, fed, {.storage = Storage::kFloat16});
  const std::vector<float> pruned =
      fuse(model, subject.lrhs, without, options_without(kConstant, Storage::kFloat16));
  const float most = *std::ranges::max_element(expected);
  for (size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(pruned[i], expected[i], most * 0x1p-8) << i;
}

// No image holds them, and nothing reads one.
TEST_F(ConstantLayersTest, TakeNoMemoryOfFrames) {
  for (const Architecture& a : architectures()) {
    const Model model = model_of(make_subject(a, 1, 1, 6));
    const FusePlan whole = plan_fusion(model, 20, 30, gpu().info(), {});
    const FusePlan pruned = plan_fusion(model, 20, 30, gpu().info(), options_without(kConstant));
    const int channels = 9, full = a.scale * a.scale * 20 * 30;
    EXPECT_EQ(whole.frame_bytes - pruned.frame_bytes, uint64_t(channels * full * 4));
    EXPECT_EQ(whole.flop, pruned.flop);
    EXPECT_LT(pruned.peak_bytes(), whole.peak_bytes());
    const auto bytes = [](const FusePlan& plan) {
      double sum = 0;
      for (const Pass& pass : plan.graph.passes()) sum += pass.bytes;
      return sum;
    };
    EXPECT_GE(bytes(whole) - bytes(pruned), 4.0 * channels * full);  // padding is read too
  }
}

TEST_F(ConstantLayersTest, WhatCannotBeIsNamed) {
  const Model model = model_of(make_subject(with_all_kinds(small_architecture(2)), 1, 1, 8));
  const auto plan = [&](const ConstantLayers& constants) {
    plan_fusion(model, 3, 4, gpu().info(), options_without(constants));
  };
  EXPECT_ERROR(plan({{"specular", {}}}), "specular", "color, albedo, normal, diffuse, variance");
  EXPECT_ERROR(plan({{"color", {}}}), "'color'");
  EXPECT_ERROR(plan({{"diffuse", {0, 0.5f, 0}}}), "diffuse", "0.5");
  EXPECT_ERROR(plan({{"albedo", {0, 0, 1.5f}}}), "albedo", "1.5");
  EXPECT_ERROR(plan({{"normal", {std::numeric_limits<float>::quiet_NaN(), 0, 0}}}), "normal", "nan");
}

TEST_F(ConstantLayersTest, ImagesMustBeWithoutThem) {
  const Subject subject = make_subject(with_all_kinds(small_architecture(2)), 3, 4, 9);
  EXPECT_ERROR(fuse(model_of(subject), subject.lrhs, subject.hrls, options_without(kAbsent)),
               "HRLS is 8x6 with 15", "8x6 with 9");
}

// Returns an image of shape (planes.size(), 2, 2).
Image image_of_layers(const std::vector<std::array<float, 4>>& planes) {
  Image image(2, 2, int(planes.size()));
  for (size_t c = 0; c < planes.size(); ++c) std::ranges::copy(planes[c], image.plane(int(c)));
  return image;
}

struct Taken {
  ConstantLayers constants;
  Image image;
};

Taken take(const std::vector<std::string>& layers, const std::vector<std::array<float, 4>>& planes,
           ConstantLayers absent = {}) {
  Architecture unused;
  raymeld::Architecture a;
  a.hrls_layers = layers;
  Taken taken{std::move(absent), image_of_layers(planes)};
  take_constant_layers(a, taken.image, taken.constants);
  return taken;
}

TEST(TakeConstantLayers, FindsWhatIsEncodedAsOneValue) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  constexpr std::array<float, 4> zero{}, grey{0.5f, 0.5f, 0.5f, 0.5f}, some{0, 0, 0, 1};
  EXPECT_EQ(take({"color", "albedo"}, {zero, zero, zero, grey, grey, grey}).constants,
            (ConstantLayers{{"albedo", {0.5f, 0.5f, 0.5f}}}));
  // The constants are clamped as encode() does; NaN is 0.
  EXPECT_EQ(
      take({"color", "albedo"}, {some, some, some, {1, 2, 3, 1e30f}, {-1, 0, -2, kNaN}, grey}).constants,
      (ConstantLayers{{"albedo", {1, 0, 0.5f}}}));
  EXPECT_EQ(take({"color", "normal"}, {some, some, some, {-1, -2, -1, -9}, grey, {0, kNaN, 0, 0}}).constants,
            (ConstantLayers{{"normal", {-1, 0.5f, 0}}}));
  // A layer that the exposure scales counts as constant only if it is 0.
  EXPECT_EQ(take({"color", "variance"}, {some, some, some, {0, -1, 0, -5}, zero, zero}).constants,
            (ConstantLayers{{"variance", {}}}));
  EXPECT_TRUE(take({"color", "diffuse"}, {some, some, some, grey, grey, grey}).constants.empty());
  EXPECT_TRUE(take({"color", "albedo"}, {some, some, some, grey, grey, some}).constants.empty());
}

TEST(TakeConstantLayers, KeepsTheOthersInOrder) {
  // The values lie within [0, 1], where nothing is clamped.
  const auto filled = [](int i) {
    const float value = float(i) / 16;
    return std::array<float, 4>{value, value, value, value + 0.03125f};
  };
  constexpr std::array<float, 4> zero{};
  const Taken taken = take({"color", "albedo", "normal", "diffuse", "specular"},
                           {filled(1), filled(2), filled(3), filled(4), filled(5), filled(6), zero, zero,
                            zero, filled(7), filled(8), filled(9)},
                           {{"albedo", {}}});
  EXPECT_EQ(taken.constants, (ConstantLayers{{"albedo", {}}, {"diffuse", {}}}));
  EXPECT_EQ(taken.image.data, image_of_layers({filled(1), filled(2), filled(3), filled(4), filled(5),
                                               filled(6), filled(7), filled(8), filled(9)})
                                  .data);
  EXPECT_EQ(taken.image.channels, 9);
}

}  // namespace
}  // namespace raymeld::test
