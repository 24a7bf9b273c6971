#include "fusion/tiling.h"

#include <gtest/gtest.h>

#include <vector>

namespace raymeld {
namespace {

// Checks that the cores tile the frame, and that every tile lies in the frame and has its halo or the edge.
void check_tiling(const Tiling& tiling) {
  const TileSize frame = tiling.frame;
  std::vector<int> kept(size_t{frame.height} * frame.width);
  for (uint32_t i = 0; i < tiling.count(); ++i) {
    const Tile tile = tiling.at(i);
    ASSERT_LE(tile.y + tiling.tile.height, frame.height);
    ASSERT_LE(tile.x + tiling.tile.width, frame.width);
    ASSERT_GE(tile.core.height * tile.core.width, 1u);
    ASSERT_LE(tile.core_y + tile.core.height, frame.height);
    ASSERT_LE(tile.core_x + tile.core.width, frame.width);
    for (uint32_t y = 0; y < tile.core.height; ++y) {
      for (uint32_t x = 0; x < tile.core.width; ++x) {
        ++kept[size_t{tile.core_y + y} * frame.width + tile.core_x + x];
      }
    }
    const auto has_halo = [&](uint32_t start, uint32_t size, uint32_t core, uint32_t core_size,
                              uint32_t frame_size) {
      const bool before = start == 0 || start + tiling.halo <= core;
      const bool after = start + size == frame_size || core + core_size + tiling.halo <= start + size;
      return before && after && start <= core && core + core_size <= start + size;
    };
    ASSERT_TRUE(has_halo(tile.y, tiling.tile.height, tile.core_y, tile.core.height, frame.height));
    ASSERT_TRUE(has_halo(tile.x, tiling.tile.width, tile.core_x, tile.core.width, frame.width));
  }
  EXPECT_EQ(std::vector<int>(kept.size(), 1), kept);
}

TEST(Tiling, CoresCoverTheFrameOnceAndTilesHaveTheirHalo) {
  for (const TileSize frame : {TileSize{1, 1}, {1, 17}, {23, 1}, {7, 13}, {40, 41}, {64, 33}}) {
    for (const uint32_t rows : {1u, 2u, 3u, 5u, 8u, 64u}) {
      for (const uint32_t columns : {1u, 2u, 4u, 7u, 41u}) {
        for (const uint32_t halo : {0u, 1u, 5u, 30u, 100u}) {
          if (rows > frame.height || columns > frame.width) continue;
          SCOPED_TRACE(testing::Message() << frame.height << " x " << frame.width << ", " << rows << " x "
                                          << columns << ", halo " << halo);
          check_tiling(make_tiling(frame, rows, columns, halo));
        }
      }
    }
  }
}

TEST(Tiling, TilesStartAtMultiplesOfTheGrid) {
  for (const TileSize frame : {TileSize{1, 1}, {1, 17}, {40, 41}, {64, 33}, {130, 96}}) {
    for (const uint32_t count : {1u, 2u, 5u, 16u}) {
      for (const uint32_t grid : {2u, 8u}) {
        SCOPED_TRACE(testing::Message() << frame.height << " x " << frame.width << ", " << count);
        const Tiling tiling = make_tiling(frame, count, count, 2 * grid, grid);
        check_tiling(tiling);
        for (uint32_t i = 0; i < tiling.count(); ++i) {
          EXPECT_EQ(tiling.at(i).y % grid, 0u);
          EXPECT_EQ(tiling.at(i).x % grid, 0u);
        }
      }
    }
  }
}

TEST(Tiling, OneTileIsTheFrame) {
  const Tiling tiling = make_tiling({30, 20}, 1, 1, 9);
  EXPECT_EQ(tiling.count(), 1u);
  EXPECT_EQ(tiling.tile.height, 30u);
  EXPECT_EQ(tiling.tile.width, 20u);
  EXPECT_EQ(tiling.overhead(), 1.0);
}

TEST(Tiling, ByHand) {
  const Tiling tiling = make_tiling({10, 12}, 2, 3, 1);  // the cores are 5 x 4, the tiles 7 x 6
  EXPECT_EQ(tiling.count(), 6u);
  EXPECT_EQ(tiling.tile.height, 7u);
  EXPECT_EQ(tiling.tile.width, 6u);
  EXPECT_DOUBLE_EQ(tiling.overhead(), 6 * 42 / 120.0);
  const Tile first = tiling.at(0), middle = tiling.at(1), last = tiling.at(5);
  EXPECT_EQ(first.y, 0u);
  EXPECT_EQ(first.x, 0u);
  EXPECT_EQ(middle.x, 3u);
  EXPECT_EQ(middle.core_x, 4u);
  EXPECT_EQ(last.y, 3u);
  EXPECT_EQ(last.x, 6u);
  EXPECT_EQ(last.core_y, 5u);
  EXPECT_EQ(last.core_x, 8u);
}

TEST(Tiling, ChoiceFitsAndIsMadeInHalves) {
  for (const uint64_t most : {1ull, 9ull, 100ull, 480ull, 500ull, 1200ull, 5000ull}) {
    for (const uint32_t halo : {0u, 1u, 4u}) {
      const auto fits = [&](TileSize tile) { return uint64_t{tile.height} * tile.width <= most; };
      const Tiling tiling = choose_tiling({40, 30}, halo, fits);
      const uint64_t smallest = uint64_t{2 * halo + 1} * (2 * halo + 1);
      if (smallest > most) {
        EXPECT_EQ(tiling.count(), 0u) << most << ", halo " << halo;
        continue;
      }
      ASSERT_GT(tiling.count(), 0u) << most << ", halo " << halo;
      EXPECT_TRUE(fits(tiling.tile));
      check_tiling(tiling);
      if (most >= 1200) {
        EXPECT_EQ(tiling.count(), 1u);
      } else {
        EXPECT_GT(tiling.count(), 1u);
      }
      if (halo == 0 && most >= 100 && most < 1200) {
        EXPECT_GT(4 * uint64_t{tiling.tile.height} * tiling.tile.width, most) << "needlessly small";
      }
    }
  }
}

TEST(Tiling, NothingFits) {
  EXPECT_EQ(choose_tiling({40, 30}, 3, [](TileSize) { return false; }).count(), 0u);
  int asked = 0;  // with a halo of the whole frame all tiles are the frame
  EXPECT_EQ(choose_tiling({40, 30}, 40, [&](TileSize) { return ++asked == 0; }).count(), 0u);
  EXPECT_EQ(asked, 1);
}

}  // namespace
}  // namespace raymeld
