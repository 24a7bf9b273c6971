// Keeps the times that frames and their parts took.
#pragma once

#include <array>
#include <cstdio>
#include <vector>

#include "renderer.h"

namespace postpass {

class Times {
 public:
  Times();

  void add_parts(const std::array<double, kParts>& part_ms);
  void add_frame(double frame_ms);
  // Return the times of the last frames, smoothed for display.
  double part_ms(size_t part) const { return shown_[part]; }
  double frame_ms() const { return shown_[kParts]; }
  // Prints the mean and percentiles of each part over the last frames.
  void print(std::FILE* file) const;

 private:
  void add(size_t row, double ms);

  // Rings of fixed size hold the last times of each part, and of whole frames.
  std::array<std::vector<float>, kParts + 1> rings_;
  std::array<size_t, kParts + 1> counts_{};
  std::array<double, kParts + 1> shown_{};
};

}  // namespace postpass
