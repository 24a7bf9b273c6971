// Tests which pixels and tiles of a frame changed, without a device.
#include "fusion/last_frame.h"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

namespace raymeld::test {
namespace {

constexpr TileSize kFrame{21, 35};
constexpr uint32_t kScale = 2, kChannels = 6;
const Tile kWhole{.core = kFrame};

class LastFrameTest : public testing::Test {
 protected:
  static size_t pixels() { return size_t{kFrame.height} * kFrame.width; }
  float& lrhs(uint32_t c, uint32_t y, uint32_t x) {
    return lrhs_[c * pixels() + size_t{y} * kFrame.width + x];
  }
  float& hrls(uint32_t c, uint32_t y, uint32_t x) {
    return hrls_[c * pixels() * kScale * kScale + size_t{y} * kScale * kFrame.width + x];
  }

  void begin(float exposure = 1) { last_.begin(lrhs_.data(), hrls_.data(), exposure); }
  // Completes a frame, so that the next one sees only later changes.
  void change_nothing() {
    begin();
    last_.end();
  }

  // Returns the columns of the changed pixels in row `y`.
  std::vector<uint32_t> changed(uint32_t y) const {
    std::vector<uint32_t> columns;
    for (uint32_t x = 0; x < kFrame.width; ++x)
      if (last_.has_changed({.y = y, .x = x, .core = {}}, {1, 1})) columns.push_back(x);
    return columns;
  }
  bool any() const { return last_.has_changed(kWhole, kFrame); }
  bool all() const {
    for (uint32_t y = 0; y < kFrame.height; ++y)
      if (changed(y).size() != kFrame.width) return false;
    return true;
  }

  using Columns = std::vector<uint32_t>;
  std::vector<float> lrhs_ = std::vector<float>(3 * pixels(), 0.5f);
  std::vector<float> hrls_ = std::vector<float>(kChannels * kScale * kScale * pixels(), 0.25f);
  LastFrame last_{kFrame, kScale, kChannels};
};

TEST_F(LastFrameTest, AllChangesUntilAFrameIsWhole) {
  begin();
  EXPECT_TRUE(all());
  begin();
  EXPECT_TRUE(all());
  last_.end();
  begin();
  EXPECT_FALSE(any());
  begin();  // the frame before was not completed
  EXPECT_TRUE(all());
}

TEST_F(LastFrameTest, APixelChangesWithItsCellOfHrls) {
  change_nothing();
  lrhs(2, 0, 0) = 0.75f;
  hrls(5, 2 * 12 + 1, 2 * 16 + 1) = 0;
  hrls(0, 2 * kFrame.height - 1, 2 * kFrame.width - 1) = 0;
  begin();
  for (uint32_t y = 0; y < kFrame.height; ++y)
    EXPECT_EQ(changed(y), y == 0                   ? Columns{0}
                          : y == 12                ? Columns{16}
                          : y == kFrame.height - 1 ? Columns{kFrame.width - 1}
                                                   : Columns{})
        << y;
}

TEST_F(LastFrameTest, TilesChangeWithAnyOfTheirPixels) {
  change_nothing();
  lrhs(0, 10, 20) = 0;
  begin();
  EXPECT_TRUE(any());
  EXPECT_TRUE(last_.has_changed({.y = 3, .x = 5, .core = {}}, {8, 16}));
  EXPECT_FALSE(last_.has_changed({.y = 3, .x = 5, .core = {}}, {7, 16}));
  EXPECT_FALSE(last_.has_changed({.y = 3, .x = 5, .core = {}}, {8, 15}));
  EXPECT_FALSE(last_.has_changed({.y = 11, .x = 20, .core = {}}, {10, 15}));
  EXPECT_FALSE(last_.has_changed({.y = 10, .x = 21, .core = {}}, {11, 14}));
}

TEST_F(LastFrameTest, ABitIsAChangeAndNaNIsNone) {
  lrhs(1, 3, 3) = std::numeric_limits<float>::quiet_NaN();
  hrls(1, 3, 60) = 0.0f;
  change_nothing();
  begin();
  EXPECT_FALSE(any());
  last_.end();
  hrls(1, 3, 60) = -0.0f;
  begin();
  EXPECT_EQ(changed(1), Columns{30});
  last_.end();
  lrhs(1, 3, 3) = std::bit_cast<float>(std::bit_cast<uint32_t>(lrhs(1, 3, 3)) | 5u);
  begin();
  EXPECT_EQ(changed(1), Columns{});
  EXPECT_EQ(changed(3), Columns{3});
}

TEST_F(LastFrameTest, AnotherExposureChangesAll) {
  change_nothing();
  begin(2);
  EXPECT_TRUE(all());
  last_.end();
  begin(2);
  EXPECT_FALSE(any());
  last_.change_all();
  EXPECT_TRUE(all());
}

TEST_F(LastFrameTest, ADistrustedTileChangesInTheNextFrameOnly) {
  change_nothing();
  begin();
  last_.distrust({.y = 8, .x = 16, .core = {}}, {1, 3});
  EXPECT_FALSE(any());
  last_.end();
  begin();
  EXPECT_EQ(changed(8), (Columns{16, 17, 18}));
  EXPECT_EQ(changed(9), Columns{});
  last_.end();
  begin();
  EXPECT_FALSE(any());
}

}  // namespace
}  // namespace raymeld::test
