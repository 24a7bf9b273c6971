// Keeps the frame that was fused last, so that only the tiles of the next one that changed are computed.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/tensor.h"
#include "fusion/tiling.h"

namespace raymeld {

class LastFrame {
 public:
  // Keeps frames of (h, w) LRHS pixels at a scale s, with K channels of HRLS.
  LastFrame(TileSize frame, uint32_t scale, uint32_t hrls_channels);

  // Takes the inputs of the next frame, lrhs (3, h, w) and hrls (K, s h, s w), in place of the last ones. An
  // LRHS pixel has changed where a bit of it, or of its s x s pixels of HRLS, has. All pixels have changed
  // where the exposure is another one, or the last frame had no end().
  void begin(const float* lrhs, const float* hrls, float exposure);
  // Makes everything count as changed in this frame.
  void change_all();
  // Makes everything in this tile count as changed in the next frame.
  void distrust(const Tile& at, TileSize tile);
  // Returns whether a pixel of this tile, its halo included, has changed.
  bool has_changed(const Tile& at, TileSize tile) const;

  // Returns the last output (3, s h, s w), in which the tiles that changed are to be replaced before end().
  float* fused() { return fused_.data(); }
  size_t fused_size() const { return fused_.size(); }
  void end();

 private:
  void take(const float* image, std::vector<float>& last, uint32_t scale);

  TileSize frame_;
  uint32_t scale_;
  std::vector<float> lrhs_, hrls_, fused_;
  float exposure_ = 0;
  bool whole_ = false;                         // the above belong together
  std::vector<uint8_t> changed_, distrusted_;  // each LRHS pixel, in this frame and in the next
};

}  // namespace raymeld
