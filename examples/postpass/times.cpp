#include "times.h"

#include <algorithm>
#include <cmath>

namespace postpass {

constexpr size_t kKept = 4096;

Times::Times() {
  for (auto& ring : rings_) ring.resize(kKept);
}

void Times::add(size_t row, double ms) {
  rings_[row][counts_[row]++ % kKept] = float(ms);
  shown_[row] = counts_[row] == 1 ? ms : 0.9 * shown_[row] + 0.1 * ms;
}

void Times::add_parts(const std::array<double, kParts>& part_ms) {
  for (size_t i = 0; i < kParts; ++i) add(i, part_ms[i]);
}

void Times::add_frame(double frame_ms) { add(kParts, frame_ms); }

void Times::print(std::FILE* file) const {
  std::fprintf(file, "milliseconds   mean    50 %%    90 %%    95 %%    99 %%\n");
  for (size_t row = 0; row <= kParts; ++row) {
    const size_t count = std::min(counts_[row], kKept);
    if (count == 0) continue;
    std::vector<float> sorted(rings_[row].begin(), rings_[row].begin() + long(count));
    std::sort(sorted.begin(), sorted.end());
    double sum = 0;
    for (const float ms : sorted) sum += ms;
    std::fprintf(file, "%-10s %8.2f", row < kParts ? kPartNames[row] : "frame", sum / double(count));
    for (const double share : {0.5, 0.9, 0.95, 0.99})
      std::fprintf(file, "%8.2f", sorted[size_t(std::ceil(share * double(count))) - 1]);
    std::fprintf(file, "\n");
  }
}

}  // namespace postpass
