// Cuts a frame into tiles of one shape, each with the halo its network needs. Pure integers.
#pragma once

#include <cstdint>
#include <functional>

namespace raymeld {

struct TileSize {
  uint32_t height = 0;
  uint32_t width = 0;

  bool operator==(const TileSize&) const = default;
};

// One tile, in LRHS pixels: what is computed, and the part of it that is kept.
struct Tile {
  uint32_t y = 0, x = 0;            // where the computed part starts in the frame
  uint32_t core_y = 0, core_x = 0;  // where the kept part starts in the frame
  TileSize core;

  // The tile of which nothing is kept but what lies in a block that starts at (y, x) of it; maybe nothing.
  Tile keeping(uint32_t block_y, uint32_t block_x, TileSize block) const;
};

// All tiles compute the same size, so that one recording serves them all; those at an edge move inwards.
struct Tiling {
  TileSize frame;
  TileSize tile;  // computed, halo included
  uint32_t rows = 1, columns = 1;

  uint32_t count() const { return rows * columns; }
  Tile at(uint32_t index) const;
  // Computed pixels by pixels of the frame: 1 without tiles.
  double overhead() const;

  uint32_t core_height = 0, core_width = 0;  // of all but the last row and column
  uint32_t halo = 0;
};

// `rows` x `columns` tiles of a frame.
Tiling make_tiling(TileSize frame, uint32_t rows, uint32_t columns, uint32_t halo);

// The fewest tiles for which `fits(tile)` holds, halving the longer side of what is kept step by step.
// Returns a tiling of count() 0 when not even tiles that keep one pixel fit.
Tiling choose_tiling(TileSize frame, uint32_t halo, const std::function<bool(TileSize)>& fits);

}  // namespace raymeld
