// Tests the library on a device of its own.
#include <gtest/gtest.h>

#include <limits>

#include "api_subject.h"

namespace raymeld::test {
namespace {

using reference::Planes;

class FusionTest : public testing::Test {
 protected:
  FusionTest() { set_cache_home(folder_ / "cache"); }

  SharedModel model_of(const Subject& subject, const std::map<std::string, std::string>& metadata = {}) {
    const std::filesystem::path file = folder_ / "model.safetensors";
    write_model(file, subject.architecture, subject.weights, metadata);
    return SharedModel(file.string());
  }

  TemporaryDirectory folder_;
  Context context_;
  Subject subject_ = make_subject(small_architecture(4), 5, 6, 3);
  raymeld_fusion_desc desc_ = fusion_desc(subject_);
};

TEST_F(FusionTest, SamplesLieWhereTheModelOrTheCallerSays) {
  const SharedModel model = model_of(subject_);
  const auto fused_with = [&](raymeld_sampling sampling) {
    desc_.lrhs_sampling = sampling;
    Fusion fusion(context_, model, desc_);
    return fuse(fusion, subject_).values;
  };
  const std::vector<float> nearest = fused_with(RAYMELD_SAMPLING_NEAREST);
  EXPECT_EQ(fused_with(RAYMELD_SAMPLING_MODEL), nearest);  // the file's lrhs_sampling decides
  EXPECT_NE(fused_with(RAYMELD_SAMPLING_CENTERED), nearest);
}

TEST_F(FusionTest, AModelMayKnowHowManySamplesAPixelHas) {
  EXPECT_FALSE(model_of(subject_).info().knows_spp);
  const SharedModel model(source_path("tests/golden/spp-x4.safetensors").string());
  EXPECT_TRUE(model.info().knows_spp);
  const auto fused_with = [&](float lrhs_spp, float hrls_spp) {
    desc_.lrhs_spp = lrhs_spp;
    desc_.hrls_spp = hrls_spp;
    Fusion fusion(context_, model, desc_);
    return fuse(fusion, subject_).values;
  };
  const std::vector<float> usual = fused_with(16, 1);
  EXPECT_EQ(fused_with(0, 0), usual);
  EXPECT_NE(fused_with(64, 1), usual);
  EXPECT_NE(fused_with(16, 2), usual);
  EXPECT_EQ(fused_with(1000, 100), fused_with(256, 16));
  for (const float spp : {-1.0f, std::numeric_limits<float>::infinity()})
    EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fused_with(spp, 1), "lrhs_spp is");
}

TEST_F(FusionTest, LayersThatMayBeZeroAndTheExposureAreTold) {
  const SharedModel model = model_of(subject_, {{"optional_layers", "normal"}, {"exposure_key", "0.2"}});
  EXPECT_EQ(model.layers(), (std::vector<std::string>{"color", "albedo", "normal"}));
  EXPECT_EQ(model.optional_layers(), std::vector<std::string>{"normal"});
  EXPECT_EQ(model.info().scale, 4u);
  EXPECT_GT(model.info().parameters, 0u);
  const std::vector<float> grey(3 * 5 * 6, 0.4f);
  EXPECT_FLOAT_EQ(Fusion(context_, model, desc_).exposure(grey.data()), 0.5f);
  desc_.exposure = 3;
  EXPECT_EQ(Fusion(context_, model, desc_).exposure(grey.data()), 3);
}

// The model was trained with zeros in place of an absent layer.
TEST_F(FusionTest, AbsentLayersAreNotRead) {
  const SharedModel model = model_of(subject_, {{"optional_layers", "normal"}});
  Subject zero = subject_;
  const size_t color_and_albedo = zero.hrls.data.size() / 3 * 2;
  std::fill(zero.hrls.data.begin() + ptrdiff_t(color_and_albedo), zero.hrls.data.end(), 0);
  desc_.precision = RAYMELD_PRECISION_FP32;
  Fusion whole(context_, model, desc_);
  const char* absent[] = {"normal"};
  desc_.absent_layer_count = 1;
  desc_.absent_layers = absent;
  Fusion fusion(context_, model, desc_);
  EXPECT_EQ(fusion.layers(), (std::vector<std::string>{"color", "albedo"}));
  const std::vector<float> expected = fuse(whole, zero).values;
  zero.hrls.data.resize(color_and_albedo);
  const std::vector<float> fused = fuse(fusion, zero).values;
  for (size_t i = 0; i < fused.size(); ++i) EXPECT_NEAR(fused[i], expected[i], 1e-4);
  absent[0] = "albedo";
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Fusion(context_, model, desc_),
                 "cannot do without layer 'albedo'; the layers that may be absent are normal");
}

TEST_F(FusionTest, WhatDidNotChangeIsSkipped) {
  desc_.precision = RAYMELD_PRECISION_FP32;
  desc_.skip_unchanged = VK_TRUE;
  Fusion fusion(context_, model_of(subject_), desc_);
  const ApiFused first = fuse(fusion, subject_);
  EXPECT_EQ(first.status.skipped_share, 0);
  const ApiFused second = fuse(fusion, subject_);
  EXPECT_EQ(second.status.skipped_share, 1);
  EXPECT_EQ(second.values, first.values);
  const auto commands = reinterpret_cast<VkCommandBuffer>(uintptr_t{16});  // is not touched
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.record(commands, {}), "raymeld_record()",
                 "skip_unchanged");
}

TEST_F(FusionTest, SaturationIsToldOnce) {
  desc_.precision = RAYMELD_PRECISION_FP16;
  Fusion sound(context_, model_of(subject_), desc_);
  EXPECT_EQ(sound.info().precision, RAYMELD_PRECISION_FP16);
  EXPECT_EQ(fuse(sound, subject_).status.saturated, 0u);
  for (double& bias : subject_.weights.at("rec").bias) bias = 1e6;
  Fusion fusion(context_, model_of(subject_), desc_);
  const raymeld_status status = fuse(fusion, subject_).status;
  EXPECT_GT(status.saturated, 0u);
  EXPECT_EQ(status.not_finite, 0u);
  EXPECT_EQ(fusion.take_status().saturated, 0u);
}

}  // namespace
}  // namespace raymeld::test
