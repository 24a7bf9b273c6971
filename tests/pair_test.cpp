#include "pair.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "error.h"

namespace raymeld {
namespace {

// The light of a made-up scene: tiles of many brightnesses under a gradient, without any symmetry.
float scene(float x, float y) {
  const int tile = int(std::floor(x / 31)) * 37 + int(std::floor(y / 23)) * 101;
  return (0.1f + float(tile * tile % 89) / 89) * (1 + 0.5f * std::sin(0.02f * x + 0.0001f * y * y));
}

Image image_of(int width, int height, const std::function<float(int, int)>& light) {
  Image image(width, height, 3);
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) image.at(c, y, x) = light(x, y);
  return image;
}

struct Pair {
  Image lrhs, hrls;
};

// A noisy HRLS of 384 x 256 and a clean LRHS, the mean of each cell or its top-left pixel.
Pair make_pair(int scale, bool centered) {
  std::mt19937 random(7);
  std::exponential_distribution<float> noise(1);
  const auto low = [&](int x, int y) {
    if (!centered) return scene(float(x * scale), float(y * scale));
    float sum = 0;
    for (int i = 0; i < scale * scale; ++i)
      sum += scene(float(x * scale + i % scale), float(y * scale + i / scale));
    return sum / float(scale * scale);
  };
  return {image_of(384 / scale, 256 / scale, low), image_of(384, 256, [&](int x, int y) {
            return scene(float(x), float(y)) * (0.5f + 0.5f * noise(random));
          })};
}

Image turned(const Image& image, bool mirrored, bool flipped) {
  return image_of(image.width, image.height, [&](int x, int y) {
    return image.at(0, flipped ? image.height - 1 - y : y, mirrored ? image.width - 1 - x : x);
  });
}

Image times(Image image, float factor) {
  for (float& value : image.data) value *= factor;
  return image;
}

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
}  // namespace raymeld
