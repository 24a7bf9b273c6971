// Cuts a frame into tiles of one shape, each with the halo its network needs. All sizes are integers.
#pragma once

#include <cstdint>
#include <functional>

namespace raymeld {

struct TileSize {
  uint32_t height = 0;
  uint32_t width = 0;

  bool operator==(const TileSize&) const = default;
};

// Describes one tile in LRHS pixels: the part that is computed, and the core, which is kept.
struct Tile {
  uint32_t y = 0, x = 0;            // start of the computed part in the frame
  uint32_t core_y = 0, core_x = 0;  // start of the core in the frame
  TileSize core;
};

// All tiles compute the same size, so that one recording serves them all; those at an edge move inwards.
struct Tiling {
  TileSize frame;
  TileSize tile;  // the computed size, halo included
  uint32_t rows = 1, columns = 1;

  uint32_t count() const { return rows * columns; }
  Tile at(uint32_t index) const;
  // Returns the ratio of computed pixels to pixels of the frame: 1 without tiles.
  double overhead() const;

  uint32_t core_height = 0, core_width = 0;  // size of all cores but those of the last row and column
  uint32_t halo = 0;
};

// Cuts a frame into at most `rows` x `columns` tiles, which start at multiples of `grid`. The halo must be
// a multiple of it too.
Tiling make_tiling(TileSize frame, uint32_t rows, uint32_t columns, uint32_t halo, uint32_t grid = 1);

// Returns the fewest tiles for which `fits(tile)` holds, found by halving the longer side of the core step by
// step. Returns a tiling of count() 0 when not even tiles that keep one pixel, or `grid` pixels, fit.
Tiling choose_tiling(TileSize frame, uint32_t halo, const std::function<bool(TileSize)>& fits,
                     uint32_t grid = 1);

}  // namespace raymeld
