// Finds the cuts of a sequence, at which a history of its frames is of no use.
#pragma once

#include <span>
#include <string>

#include "io/image.h"

namespace raymeld {

// Compares each frame with the one before it in cells of 4x4 full-size pixels: by albedo and normal, or by
// brightness where HRLS has neither.
class CutFinder {
 public:
  // Returns whether a frame begins a new shot: its motion leads hardly any cell into the last frame, or most
  // to one that looks otherwise. `lrhs` is (3, h, w), and hrls (3 layers, s h, s w) has these layers;
  // `motion` is that of Fuser::fuse(). The first frame is no cut.
  bool is_cut(const Image& lrhs, const Image& hrls, std::span<const std::string> layers, const Image& motion);

  // Makes the next frame the first one.
  void forget() { last_ = {}; }

 private:
  Image last_;  // the cells of the last frame
};

}  // namespace raymeld
