#include "fusion/tiling.h"

#include <algorithm>

#include "numbers.h"

namespace raymeld {
namespace {

// Returns where a tile that keeps [core, core + core_size) starts, so that it has its halo or touches the
// frame's edge.
uint32_t start_of(uint32_t core, uint32_t halo, uint32_t tile, uint32_t frame) {
  return std::min(core > halo ? core - halo : 0, frame - tile);
}

}  // namespace

Tiling make_tiling(TileSize frame, uint32_t rows, uint32_t columns, uint32_t halo, uint32_t grid) {
  Tiling tiling;
  tiling.frame = frame;
  tiling.halo = halo;
  const auto core_of = [&](uint32_t side, uint32_t count) {
    return std::min(side, divide_up(divide_up(side, count), grid) * grid);
  };
  // Tiles at the far edge start at a multiple of the grid too.
  const auto tile_of = [&](uint32_t side, uint32_t core) {
    return std::min(side, core + 2 * halo + side % grid);
  };
  tiling.core_height = core_of(frame.height, rows);
  tiling.core_width = core_of(frame.width, columns);
  tiling.rows = divide_up(frame.height, tiling.core_height);
  tiling.columns = divide_up(frame.width, tiling.core_width);
  tiling.tile.height = tile_of(frame.height, tiling.core_height);
  tiling.tile.width = tile_of(frame.width, tiling.core_width);
  return tiling;
}

Tile Tiling::at(uint32_t index) const {
  Tile result;
  result.core_y = index / columns * core_height;
  result.core_x = index % columns * core_width;
  result.core.height = std::min(core_height, frame.height - result.core_y);
  result.core.width = std::min(core_width, frame.width - result.core_x);
  result.y = start_of(result.core_y, halo, tile.height, frame.height);
  result.x = start_of(result.core_x, halo, tile.width, frame.width);
  return result;
}

double Tiling::overhead() const {
  return static_cast<double>(count()) * tile.height * tile.width / (double(frame.height) * frame.width);
}

Tiling choose_tiling(TileSize frame, uint32_t halo, const std::function<bool(TileSize)>& fits,
                     uint32_t grid) {
  Tiling tiling = make_tiling(frame, 1, 1, halo, grid);
  TileSize refused;  // halving the core does not change a tile that reaches the frame's edges
  while (tiling.tile == refused || !fits(tiling.tile)) {
    refused = tiling.tile;
    if (tiling.core_height <= grid && tiling.core_width <= grid) {
      tiling.rows = 0;
      return tiling;
    }
    const bool split_rows = tiling.core_height >= tiling.core_width;
    tiling = split_rows ? make_tiling(frame, divide_up(frame.height, divide_up(tiling.core_height, 2)),
                                      tiling.columns, halo, grid)
                        : make_tiling(frame, tiling.rows,
                                      divide_up(frame.width, divide_up(tiling.core_width, 2)), halo, grid);
  }
  return tiling;
}

}  // namespace raymeld
