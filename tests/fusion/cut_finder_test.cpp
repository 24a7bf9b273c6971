// Tests what is taken for a cut, and what is not.
#include "fusion/cut_finder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace raymeld::test {
namespace {

constexpr int kWidth = 96, kHeight = 64;
const std::vector<std::string> kLayers = {"color", "albedo"};

struct Frame {
  Image lrhs = Image(kWidth / 4, kHeight / 4, 3), hrls = Image(kWidth, kHeight, 6),
        motion = Image(kWidth, kHeight, 2);
};

// Returns a view of blocks of 16x16 pixels, whose place and albedo the room decides, moved to the right by so
// many pixels since the last frame; the albedo has noise.
Frame make_frame(int room, int moved = 0, int motion = 0, float light = 1) {
  Frame frame;
  std::mt19937 random(uint32_t(room * 100 + moved));
  std::normal_distribution<float> noise(0, 0.1f);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const int block = (x - moved + 1600) / 16 * 7 + y / 16 * 13 + room * 5;
      for (int c = 0; c < 3; ++c)
        frame.hrls.at(3 + c, y, x) = 0.2f + 0.2f * float(block * (room + c) % 4) + noise(random);
      frame.motion.at(0, y, x) = float(-motion);
    }
  }
  std::ranges::fill(frame.lrhs.data, light);
  return frame;
}

bool is_cut(CutFinder& finder, const Frame& frame, const std::vector<std::string>& layers = kLayers) {
  return finder.is_cut(frame.lrhs, frame.hrls, layers, frame.motion);
}

TEST(CutFinder, AMovedViewIsNone) {
  CutFinder finder;
  EXPECT_FALSE(is_cut(finder, make_frame(1)));  // the first frame
  EXPECT_FALSE(is_cut(finder, make_frame(1, 8, 8)));
  EXPECT_FALSE(is_cut(finder, make_frame(1, 72, 64)));      // a third of it was in the last frame
  EXPECT_FALSE(is_cut(finder, make_frame(1, 72, 0, 100)));  // the light does not count
}

TEST(CutFinder, AnotherViewIsOne) {
  CutFinder finder;
  is_cut(finder, make_frame(1));
  EXPECT_TRUE(is_cut(finder, make_frame(2)));
  EXPECT_FALSE(is_cut(finder, make_frame(2, 4, 4)));
  EXPECT_TRUE(is_cut(finder, make_frame(2, 100, 96)));  // nothing of it was in the last frame
  Frame unknown = make_frame(2, 100);
  std::ranges::fill(unknown.motion.data, std::numeric_limits<float>::quiet_NaN());
  EXPECT_TRUE(is_cut(finder, unknown));
  finder.forget();
  EXPECT_FALSE(is_cut(finder, make_frame(1)));
}

TEST(CutFinder, BrightnessDecidesWithoutGuides) {
  CutFinder finder;
  const std::vector<std::string> layers = {"color", "diffuse"};
  is_cut(finder, make_frame(1), layers);
  EXPECT_FALSE(is_cut(finder, make_frame(2, 0, 0, 3), layers));
  EXPECT_TRUE(is_cut(finder, make_frame(2, 0, 0, 20), layers));
}

}  // namespace
}  // namespace raymeld::test
