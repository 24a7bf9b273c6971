// Tests which model a curve chooses.
#include "choice/curve.h"

#include <gtest/gtest.h>

#include <cmath>

#include "error_of.h"
#include "support.h"

namespace raymeld::test {
namespace {

Candidate candidate(const std::string& name, double time_ms, double psnr_db) {
  return {{name, 4, 1, psnr_db, {}}, time_ms};
}

std::vector<std::string> names_of(const std::vector<Candidate>& candidates) {
  std::vector<std::string> names;
  for (const Candidate& candidate : candidates) names.push_back(candidate.point.model);
  return names;
}

const std::vector<Candidate> kFront{candidate("a", 10, 30), candidate("b", 20, 30.2),
                                    candidate("c", 80, 30.21)};

TEST(Curve, FrontHasWhatNoOtherBeats) {
  const std::vector<Candidate> front =
      front_of({candidate("slow", 9, 30), candidate("best", 20, 33), candidate("fast", 5, 31),
                candidate("twin", 5, 30.5), candidate("equal", 30, 33)});
  EXPECT_EQ(names_of(front), (std::vector<std::string>{"fast", "best"}));
}

TEST(Curve, LevelsAreRatesOfExchange) {
  EXPECT_EQ(at_level(kFront, 0).point.model, "a");
  EXPECT_EQ(at_level(kFront, 100).point.model, "c");
  // A doubling of the time must bring 0.1 dB. The first brings 0.2, the quadrupling after it only 0.01.
  EXPECT_EQ(at_level(kFront, kBalanced).point.model, "b");
  EXPECT_EQ(at_level(kFront, 34).point.model, "b");  // a doubling must bring 0.194
  EXPECT_EQ(at_level(kFront, 33).point.model, "a");  // a doubling must bring 0.203
  EXPECT_EQ(at_level(kFront, 96).point.model, "c");  // a doubling must bring 0.0042, and brings 0.005
  EXPECT_EQ(at_level(kFront, 95).point.model, "b");  // a doubling must bring 0.0053
}

TEST(Curve, BudgetIsKept) {
  EXPECT_EQ(within_budget(kFront, 80).point.model, "c");
  EXPECT_EQ(within_budget(kFront, 79.9).point.model, "b");
  EXPECT_EQ(within_budget(kFront, 15).point.model, "a");
  EXPECT_EQ(within_budget(kFront, 1).point.model, "a");
}

TEST(Curve, TargetTakesTheFastestThatIsExpectedToReachIt) {
  std::vector<Candidate> front = kFront;
  for (Candidate& candidate : front) candidate.point.estimate = {candidate.point.psnr_db, 1, 0, 1};
  const FrameTraits traits{2, 7};  // raises each estimate by 2 dB
  EXPECT_EQ(for_target(front, traits, 31).point.model, "a");
  EXPECT_EQ(for_target(front, traits, 32.1).point.model, "b");
  for (const double beyond : {40, 99, 1000000}) EXPECT_EQ(for_target(front, traits, beyond).point.model, "c");
  EXPECT_DOUBLE_EQ(front[0].point.estimate.probability(traits, 32), 0.5);
  EXPECT_NEAR(front[0].point.estimate.probability(traits, 33), 0.1587, 1e-4);
  EXPECT_NEAR(front[0].point.estimate.probability(traits, 30), 0.9772, 1e-4);
}

std::vector<Observation> observations(size_t scenes, double noise) {
  std::vector<Observation> all;
  for (size_t i = 0; i < scenes; ++i) {
    for (const double detail : {-30.0, -25.0}) {
      const FrameTraits traits{20 + double(i * i % 7), detail + double(i)};
      all.push_back({std::to_string(i), traits,
                     3 + 0.5 * traits.agreement_db - 0.25 * traits.detail_db + (i % 2 ? noise : -noise)});
    }
  }
  return all;
}

TEST(Curve, PsnrIsEstimatedByTraits) {
  const PsnrEstimate exact = fit_psnr(observations(9, 0));
  EXPECT_NEAR(exact.constant, 3, 1e-6);
  EXPECT_NEAR(exact.per_agreement, 0.5, 1e-7);
  EXPECT_NEAR(exact.per_detail, -0.25, 1e-7);
  EXPECT_NEAR(exact.error_db, 0, 1e-6);
  const double error = fit_psnr(observations(9, 0.5)).error_db;
  EXPECT_GT(error, 0.5);  // each scene is judged by a fit to the others
  EXPECT_LT(error, 1.2);
}

TEST(Curve, PsnrNeedsScenesThatDiffer) {
  EXPECT_EQ(error_of([] { fit_psnr(observations(7, 0)); }),
            "7 scenes are too few to fit an estimate of the PSNR, expected at least 8");
  std::vector<Observation> same = observations(9, 0);
  for (Observation& observation : same) observation.traits = {20, -30};
  EXPECT_EQ(error_of([&] { fit_psnr(same); }),
            "the scenes are too similar to fit an estimate of the PSNR to them");
}

TEST(Curve, TraitsOfFlatAndOfNoisyImages) {
  Image lrhs(4, 4, 3), hrls(8, 8, 6);
  lrhs.data.assign(lrhs.data.size(), 0.25f);
  hrls.data.assign(hrls.data.size(), 0.25f);
  const FrameTraits flat = traits_of(lrhs, hrls, 0);
  EXPECT_EQ(flat.agreement_db, 60);
  EXPECT_EQ(flat.detail_db, -60);
  // Rows of 0 and 1 in sRGB take turns: 3 of the 4 rows differ by 1 from the row above.
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 4; ++x) lrhs.at(c, y, x) = float(y % 2);
  const FrameTraits striped = traits_of(lrhs, hrls, 0);
  EXPECT_NEAR(striped.detail_db, 10 * std::log10(0.75), 1e-9);
  EXPECT_LT(striped.agreement_db, 10);
  // Layers after the color make no difference.
  std::fill_n(hrls.plane(3), 3 * hrls.plane_size(), 9.0f);
  EXPECT_EQ(traits_of(lrhs, hrls, 0).agreement_db, striped.agreement_db);
}

TEST(Curve, IsKeptInAFile) {
  const TemporaryDirectory folder;
  const Curve curve{"device", "set", {{"x2-a", 2, 12.5, 33.25, {1, 2, 3, 0.5}}, {"x4-b", 4, 1, 30, {}}}};
  save_curve(folder / "curve.json", curve);
  const Curve loaded = load_curve(folder / "curve.json");
  EXPECT_EQ(loaded.device, "device");
  EXPECT_EQ(loaded.data, "set");
  ASSERT_EQ(loaded.points.size(), 2u);
  EXPECT_EQ(loaded.points[0].model, "x2-a");
  EXPECT_EQ(loaded.points[0].scale, 2u);
  EXPECT_EQ(loaded.points[0].time_ms, 12.5);
  EXPECT_EQ(loaded.points[0].psnr_db, 33.25);
  EXPECT_EQ(loaded.points[0].estimate.error_db, 0.5);
}

TEST(Curve, BadFilesAreErrorsThatNameThem) {
  const TemporaryDirectory folder;
  const std::filesystem::path file = folder / "curve.json";
  const auto error = [&](std::string_view content) {
    write_file(file, content);
    return error_of([&] { load_curve(file); });
  };
  EXPECT_NE(error("{").find("curve '" + file.string() + "'"), std::string::npos);
  EXPECT_NE(error(R"({"format_version": 9})").find("its format_version is 9, expected 1"), std::string::npos);
  EXPECT_NE(error(R"({"format_version": 1, "device": "", "data": "", "points": [{"model": "x2-a"}]})")
                .find("estimate"),
            std::string::npos);
  std::filesystem::remove(file);
  EXPECT_NE(error_of([&] { load_curve(file); }).find("cannot be read"), std::string::npos);
}

}  // namespace
}  // namespace raymeld::test
