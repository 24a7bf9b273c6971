#include <algorithm>
#include <cmath>

#include "reference/interval.h"
#include "reference/reference.h"

namespace raymeld::reference {
namespace {

template <typename T>
T root_of_luminance(const T& r, const T& g, const T& b) {
  using std::sqrt;
  return sqrt(T(T(0.2126) * r + T(0.7152) * g + T(0.0722) * b));
}

double color_of(double value) { return std::isnan(value) ? 0 : std::clamp(value, 0.0, 65504.0); }

// A subnormal color may be flushed to 0 as it is read.
Interval read(double color) { return {color < kFlush ? 0 : color, color}; }

}  // namespace

Bounded exposure(const Planes& lrhs, double key) {
  constexpr int kRuns = 1 << 14, kTreeAdditions = 14;
  constexpr double kLeastRoot = 0x1p-12, kMostRoot = 0x1p12;
  const int pixels = lrhs.h * lrhs.w;
  double sum = 0, low = 0, high = 0;
  for (int i = 0; i < pixels; ++i) {
    const auto color = [&](int c) { return color_of(lrhs.data[size_t(c) * size_t(pixels) + size_t(i)]); };
    const double r = color(0), g = color(1), b = color(2);
    if (r == 0 && g == 0 && b == 0) continue;
    sum += root_of_luminance(r, g, b);
    const Interval read_root = root_of_luminance(read(r), read(g), read(b));
    low += std::max(read_root.low, 0.0);
    high += read_root.high;
  }
  if (sum == 0) return exact(Planes(2, 1, 1, {1, 1}));
  const double scale = std::sqrt(key) * pixels, off = gamma((pixels + kRuns - 1) / kRuns + kTreeAdditions);
  const double root = std::clamp(scale / sum, kLeastRoot, kMostRoot);
  const Interval sums{low * (1 - off), high * (1 + off)};
  Interval device_root = clamp(rounded({scale, scale}, kUnit) / sums, kLeastRoot, kMostRoot);
  if (sums.low == 0) device_root = {std::min(device_root.low, 1.0), std::max(device_root.high, 1.0)};
  const Interval device = square(device_root), inverse = Interval(1.0) / device;
  const double value = square(root);
  return {Planes(2, 1, 1, {value, 1 / value}),
          Planes(2, 1, 1,
                 {std::max(value - device.low, device.high - value),
                  std::max(1 / value - inverse.low, inverse.high - 1 / value)})};
}

}  // namespace raymeld::reference
