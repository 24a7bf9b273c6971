// Which blocks of a frame depend on what changed, without a device.
#include "last_frame.h"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

#include "engine/graph.h"

namespace raymeld::test {
namespace {

constexpr TileSize kFrame{21, 35};
constexpr uint32_t kScale = 2, kChannels = 6, kSide = SparseGrid::kSide;
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
  // After a frame that changed nothing.
  void change_nothing() {
    begin();
    last_.end();
  }

  // The columns of changed blocks, by row.
  std::vector<std::vector<uint32_t>> changed(uint32_t reach, const Tile& at = kWhole,
                                             TileSize tile = kFrame) const {
    const SparseGrid grid{tile.height, tile.width};
    const std::vector<bool> blocks = last_.changed_blocks(at, tile, reach);
    EXPECT_EQ(blocks.size(), grid.blocks());
    std::vector<std::vector<uint32_t>> rows(grid.rows());
    for (uint32_t i = 0; i < blocks.size(); ++i)
      if (blocks[i]) rows[i / grid.columns()].push_back(i % grid.columns());
    return rows;
  }

  using Blocks = std::vector<std::vector<uint32_t>>;
  const Blocks all_{{0, 1, 2, 3, 4}, {0, 1, 2, 3, 4}, {0, 1, 2, 3, 4}}, none_{{}, {}, {}};
  std::vector<float> lrhs_ = std::vector<float>(3 * pixels(), 0.5f);
  std::vector<float> hrls_ = std::vector<float>(kChannels * kScale * kScale * pixels(), 0.25f);
  LastFrame last_{kFrame, kScale, kChannels};
};

TEST_F(LastFrameTest, AllChangesUntilAFrameIsWhole) {
  begin();
  EXPECT_EQ(changed(0), all_);
  begin();
  EXPECT_EQ(changed(0), all_);
  last_.end();
  begin();
  EXPECT_EQ(changed(40), none_);
  begin();  // the one before was given up
  EXPECT_EQ(changed(0), all_);
}

TEST_F(LastFrameTest, BlocksWithinReachOfAPixelChange) {
  change_nothing();
  lrhs(2, 0, 0) = 0.75f;
  begin();
  EXPECT_EQ(changed(0), (Blocks{{0}, {}, {}}));
  EXPECT_EQ(changed(7), (Blocks{{0}, {}, {}}));
  EXPECT_EQ(changed(8), (Blocks{{0, 1}, {0, 1}, {}}));
  EXPECT_EQ(changed(16), (Blocks{{0, 1, 2}, {0, 1, 2}, {0, 1, 2}}));
  EXPECT_EQ(changed(1000), all_);
  last_.end();
  hrls(5, 2 * 12 + 1, 2 * 16 + 1) = 0;  // of LRHS's pixel 12, 16
  begin();
  EXPECT_EQ(changed(0), (Blocks{{}, {2}, {}}));
  EXPECT_EQ(changed(1), (Blocks{{}, {1, 2}, {}}));
  EXPECT_EQ(changed(4), (Blocks{{}, {1, 2}, {1, 2}}));
  EXPECT_EQ(changed(5), (Blocks{{1, 2}, {1, 2}, {1, 2}}));
  last_.end();
  hrls(0, 2 * kFrame.height - 1, 2 * kFrame.width - 1) = 0;
  begin();
  EXPECT_EQ(changed(0), (Blocks{{}, {}, {4}}));
  EXPECT_EQ(changed(3), (Blocks{{}, {}, {3, 4}}));
}

TEST_F(LastFrameTest, ABitIsAChangeAndNaNIsNone) {
  lrhs(1, 3, 3) = std::numeric_limits<float>::quiet_NaN();
  hrls(1, 3, 60) = 0.0f;
  change_nothing();
  begin();
  EXPECT_EQ(changed(0), none_);
  last_.end();
  hrls(1, 3, 60) = -0.0f;
  begin();
  EXPECT_EQ(changed(0), (Blocks{{3}, {}, {}}));
  last_.end();
  lrhs(1, 3, 3) = std::bit_cast<float>(std::bit_cast<uint32_t>(lrhs(1, 3, 3)) | 5u);
  begin();
  EXPECT_EQ(changed(0), (Blocks{{0}, {}, {}}));
}

TEST_F(LastFrameTest, AnotherExposureChangesAll) {
  change_nothing();
  begin(2);
  EXPECT_EQ(changed(0), all_);
  last_.end();
  begin(2);
  EXPECT_EQ(changed(0), none_);
  last_.change_all();
  EXPECT_EQ(changed(0), all_);
}

// Blocks are counted from a tile's corner, and what lies outside of the tile is not read.
TEST_F(LastFrameTest, TilesHaveTheirOwnBlocks) {
  change_nothing();
  lrhs(0, 10, 20) = 0;
  begin();
  const TileSize tile{16, 20};
  EXPECT_EQ(changed(0, {.y = 3, .x = 5, .core = {}}, tile), (Blocks{{1}, {}}));
  EXPECT_EQ(changed(1, {.y = 3, .x = 5, .core = {}}, tile), (Blocks{{1, 2}, {1, 2}}));
  EXPECT_EQ(changed(1000, {.y = 0, .x = 0, .core = {}}, tile), (Blocks{{}, {}}));
  EXPECT_EQ(changed(1000, {.y = 0, .x = 0, .core = {}}, {16, 21}), (Blocks{{0, 1, 2}, {0, 1, 2}}));
}

TEST_F(LastFrameTest, ADistrustedTileChangesInTheNextFrameOnly) {
  change_nothing();
  begin();
  last_.distrust({.y = 8, .x = 16, .core = {}}, {8, 8});
  EXPECT_EQ(changed(0), none_);
  last_.end();
  begin();
  EXPECT_EQ(changed(0), (Blocks{{}, {2}, {}}));
  last_.end();
  begin();
  EXPECT_EQ(changed(0), none_);
}

}  // namespace
}  // namespace raymeld::test
