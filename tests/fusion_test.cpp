// The public face, on a device of its own.
#include <gtest/gtest.h>

#include <cstdlib>

#include "error_of.h"
#include "raymeld/raymeld.hpp"
#include "subject.h"

namespace raymeld::test {
namespace {

class FusionTest : public testing::Test {
 protected:
  FusionTest() { setenv("XDG_CACHE_HOME", (folder_ / "cache").c_str(), 1); }

  std::string model_of(const Subject& subject) {
    const std::filesystem::path file = folder_ / "model.safetensors";
    write_model(file, subject.architecture, subject.weights);
    return file.string();
  }

  TemporaryDirectory folder_;
  Subject subject_ = make_subject(small_architecture(4), 5, 6, 3);
};

using reference::Planes;

struct Fused {
  std::vector<float> values;
  FusionStatus status;
};

Fused fuse(Fusion& fusion, const Subject& subject) {
  Fused fused;
  const size_t scale = fusion.scale();
  fused.values.resize(subject.lrhs.data.size() * scale * scale);
  fused.status = fusion.fuse(floats(subject.lrhs).data(), floats(subject.hrls).data(), fused.values.data());
  return fused;
}

TEST_F(FusionTest, SamplesLieWhereTheModelOrTheCallerSays) {
  const std::string file = model_of(subject_);
  const auto fused_with = [&](LrhsSampling sampling) {
    Fusion fusion(file, 5, 6, {.precision = Precision::kFp32, .lrhs_sampling = sampling});
    return fuse(fusion, subject_).values;
  };
  const std::vector<float> nearest = fused_with(LrhsSampling::kNearest);
  EXPECT_EQ(fused_with(LrhsSampling::kModel), nearest);  // what the file's lrhs_sampling says
  EXPECT_NE(fused_with(LrhsSampling::kCentered), nearest);
}

TEST_F(FusionTest, LayersThatMayBeZeroAndTheExposureAreTold) {
  const std::filesystem::path file = folder_ / "model.safetensors";
  write_model(file, subject_.architecture, subject_.weights,
              {{"optional_layers", "normal"}, {"exposure_key", "0.2"}});
  Fusion fusion(file.string(), 5, 6);
  EXPECT_EQ(fusion.optional_layers(), std::vector<std::string>{"normal"});
  const std::vector<float> grey(3 * 5 * 6, 0.4f);
  EXPECT_FLOAT_EQ(fusion.exposure(grey.data()), 0.5f);
  EXPECT_EQ(Fusion(file.string(), 5, 6, {.exposure = 3}).exposure(grey.data()), 3);
}

TEST_F(FusionTest, WhatAgreesNeedsNoNetwork) {
  for (Planes* image : {&subject_.lrhs, &subject_.hrls}) std::ranges::fill(image->data, 0.25);
  Fusion fusion(model_of(subject_), 5, 6, {.precision = Precision::kFp32, .adaptive_threshold = 0.01f});
  const Fused fused = fuse(fusion, subject_);
  EXPECT_EQ(fused.status.settled_share, 1);
  EXPECT_EQ(fusion.take_status().settled_share, 1);
  for (const float value : fused.values) EXPECT_NEAR(value, 0.25, 1e-6);
  EXPECT_ERROR(Fusion(model_of(subject_), 5, 6, {.adaptive_threshold = -1}), "a threshold of -1");
}

TEST_F(FusionTest, WhatDidNotChangeIsKept) {
  Fusion fusion(model_of(subject_), 5, 6, {.precision = Precision::kFp32, .changed_only = true});
  const Fused first = fuse(fusion, subject_);
  EXPECT_EQ(first.status.kept_share, 0);
  const Fused second = fuse(fusion, subject_);
  EXPECT_EQ(second.status.kept_share, 1);
  EXPECT_EQ(second.status.settled_share, 0);
  EXPECT_EQ(second.values, first.values);
  EXPECT_ERROR(fusion.record(VK_NULL_HANDLE, {}, {}, {}), "record()", "changed_only");
}

TEST_F(FusionTest, SaturationIsToldOnce) {
  Fusion sound(model_of(subject_), 5, 6, {.precision = Precision::kFp16});
  EXPECT_EQ(fuse(sound, subject_).status.saturated, 0u);
  for (double& bias : subject_.weights.at("rec").bias) bias = 1e6;
  Fusion fusion(model_of(subject_), 5, 6, {.precision = Precision::kFp16});
  const FusionStatus status = fuse(fusion, subject_).status;
  EXPECT_GT(status.saturated, 0u);
  EXPECT_EQ(status.not_finite, 0u);
  EXPECT_EQ(fusion.take_status().saturated, 0u);
}

TEST_F(FusionTest, WhatIsWrongIsNamed) {
  EXPECT_ERROR(Fusion((folder_ / "none.safetensors").string(), 5, 6), "none.safetensors");
  const std::string file = model_of(subject_);
  EXPECT_ERROR(Fusion(file, 5, 6, {.device = "no such device"}), "no such device");
  EXPECT_ERROR(Fusion(file, 50, 60, {.max_memory_bytes = 1000}), "smallest tile");
}

}  // namespace
}  // namespace raymeld::test
