#include "fusion/pair.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "error.h"
#include "made_pair.h"

namespace raymeld::test {
namespace {

Relation relation(const Image& lrhs, const Image& hrls) {
  return examine_pair(lrhs, hrls, hrls.width / lrhs.width).relation;
}

class PairTest : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Scales, PairTest, testing::Values(2, 4, 8));

TEST_P(PairTest, PhaseIsFound) {
  for (const bool centered : {false, true}) {
    const Pair pair = make_pair(GetParam(), centered);
    const PairFindings found = examine_pair(pair.lrhs, pair.hrls, GetParam());
    EXPECT_TRUE(found.shows_phase());
    EXPECT_EQ(found.is_nearest(), !centered);
    EXPECT_EQ(found.relation, Relation::kSame);
    EXPECT_EQ(found.brightness, 1);
  }
}

TEST_P(PairTest, BrightnessOfEitherChangesNoOtherFinding) {
  const Pair pair = make_pair(GetParam(), true);
  const PairFindings plain = examine_pair(pair.lrhs, pair.hrls, GetParam());
  for (const float factor : {0.25f, 4.0f}) {
    const PairFindings found = examine_pair(times(pair.lrhs, factor), pair.hrls, GetParam());
    EXPECT_NEAR(found.brightness * factor, 1, 0.1);
    EXPECT_EQ(found.relation, Relation::kSame);
    EXPECT_NEAR(found.phase_evidence, plain.phase_evidence, 0.01 * std::abs(plain.phase_evidence));
  }
}

TEST_P(PairTest, FirefliesOfHrlsAreNoBrightness) {
  Pair pair = make_pair(GetParam(), true);
  std::mt19937 random(6);
  for (int y = 0; y < pair.hrls.height; ++y)
    for (int x = 0; x < pair.hrls.width; ++x)
      if (random() % 500 == 0)
        for (int c = 0; c < 3; ++c) pair.hrls.at(c, y, x) *= 1000;
  EXPECT_EQ(examine_pair(pair.lrhs, pair.hrls, GetParam()).brightness, 1);
}

// Colors at one sample per pixel are mostly noise, and only a clean guide shows which phase the LRHS has.
TEST_P(PairTest, AGuideShowsThePhaseOfNoisyColors) {
  for (const bool centered : {false, true}) {
    const Pair pair = make_pair(GetParam(), centered);
    Image guided(pair.hrls.width, pair.hrls.height, 4);
    std::mt19937 random(5);
    std::exponential_distribution<float> noise(1);
    for (int y = 0; y < guided.height; ++y) {
      for (int x = 0; x < guided.width; ++x) {
        const float light = scene(float(x), float(y));
        for (int c = 0; c < 3; ++c) guided.at(c, y, x) = light * 10 * std::pow(noise(random), 4.0f);
        guided.at(3, y, x) = light;
      }
    }
    const PairFindings without = examine_pair(pair.lrhs, guided, GetParam());
    const PairFindings with = examine_pair(pair.lrhs, guided, GetParam(), std::array{3});
    EXPECT_EQ(with.is_nearest(), !centered);
    EXPECT_GT(std::abs(with.phase_evidence), std::abs(without.phase_evidence));
  }
}

TEST_P(PairTest, FirefliesChangeNothing) {
  Pair pair = make_pair(GetParam(), false);
  for (size_t i = 50; i < pair.hrls.plane_size(); i += 997)
    for (int c = 0; c < 3; ++c) pair.hrls.plane(c)[i] = 65504;
  const PairFindings found = examine_pair(pair.lrhs, pair.hrls, GetParam());
  EXPECT_TRUE(found.is_nearest());
  EXPECT_EQ(found.relation, Relation::kSame);
}

TEST(PairRelationTest, TurnedLrhsIsNamed) {
  const Pair pair = make_pair(4, true);
  EXPECT_EQ(relation(turned(pair.lrhs, true, false), pair.hrls), Relation::kMirrored);
  EXPECT_EQ(relation(turned(pair.lrhs, false, true), pair.hrls), Relation::kFlipped);
  EXPECT_EQ(relation(turned(pair.lrhs, true, true), pair.hrls), Relation::kTurned);
}

TEST(PairRelationTest, NoiseIsForeign) {
  const Pair pair = make_pair(4, true);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  EXPECT_EQ(relation(image_of(96, 64, [&](int, int) { return uniform(random); }), pair.hrls),
            Relation::kForeign);
}

// The LRHS is the render of a camera that looked elsewhere, or a mix of such a render and the right one.
TEST(PairRelationTest, AnotherCameraIsForeignAndPartOfItDoubtful) {
  const Pair pair = make_pair(4, true);
  const auto mixed = [&](float share) { return mixed_with_another_camera(pair.lrhs, share); };
  EXPECT_EQ(relation(mixed(1), pair.hrls), Relation::kForeign);
  EXPECT_EQ(relation(mixed(0), pair.hrls), Relation::kSame);
  std::vector<Relation> found;
  for (float share = 0; share <= 1; share += 0.05f) found.push_back(relation(mixed(share), pair.hrls));
  EXPECT_EQ(std::ranges::count(found, Relation::kDoubtful) > 0, true);
  EXPECT_TRUE(std::ranges::is_sorted(found));
}

TEST(PairRelationTest, ImagesWithoutStructureAreNotJudged) {
  const Pair pair = make_pair(4, true);
  for (const float light : {0.0f, 1.0f}) {
    const Image flat = image_of(96, 64, [&](int, int) { return light; });
    const Image flat_hrls = image_of(384, 256, [&](int, int) { return light; });
    for (const auto& [lrhs, hrls] :
         {std::pair(&flat, &pair.hrls), {&pair.lrhs, &flat_hrls}, {&flat, &flat_hrls}}) {
      const PairFindings found = examine_pair(*lrhs, *hrls, 4);
      EXPECT_EQ(found.relation, Relation::kUnknown);
    }
    const PairFindings both = examine_pair(flat, flat_hrls, 4);
    EXPECT_FALSE(both.shows_phase());
    EXPECT_FALSE(both.is_nearest());
    EXPECT_EQ(both.brightness, 1);
  }
}

TEST(PairRelationTest, SizesThatDoNotFitAreAnError) {
  EXPECT_THROW(examine_pair(Image(8, 8, 3), Image(16, 16, 3), 4), Error);
}

}  // namespace
}  // namespace raymeld::test
