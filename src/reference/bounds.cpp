#include "reference/bounds.h"

#include <fmt/format.h>

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

namespace raymeld::reference {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFirstHalfOverflow = 65520;  // halfway from the largest half, 65504, to 2^16

double ratio_of(double actual, double expected, double bound) {
  if (actual == expected || (std::isnan(actual) && std::isnan(expected))) return 0;
  const double ratio = std::abs(actual - expected) / bound;
  return std::isfinite(bound) && !std::isnan(ratio) ? ratio : kInfinity;
}

}  // namespace

Planes::Planes(int c, int h, int w, std::vector<double> values) : c(c), h(h), w(w), data(std::move(values)) {
  if (data.size() != size_t(c) * h * w) {
    throw std::invalid_argument(fmt::format("{} values for {} x {} x {} planes", data.size(), c, h, w));
  }
}

double round_to_half(double value) {
  if (value == 0 || !std::isfinite(value)) return value;
  if (std::abs(value) >= kFirstHalfOverflow) return std::copysign(kInfinity, value);
  const int exponent = std::max(std::ilogb(value), -14);  // all subnormals share the smallest normals' step
  const double step = std::ldexp(1.0, exponent - 10);
  return std::nearbyint(value / step) * step;
}

double round_to(double value, Precision precision) {
  return precision == Precision::kFp16 ? round_to_half(value) : double(float(value));
}

Planes round_to(Planes planes, Precision precision) {
  for (double& v : planes.data) v = round_to(v, precision);
  return planes;
}

Bounded exact(Planes value) {
  Planes bound(value.c, value.h, value.w);
  return {std::move(value), std::move(bound)};
}

double gamma(int roundings) { return roundings * kUnit / (1 - roundings * kUnit); }

double stored_bound(double value, double bound, Precision precision) {
  const double reach = std::abs(value) + bound;
  if (reach == 0) return 0;
  if (precision == Precision::kFp32) return reach <= FLT_MAX ? bound : kInfinity;
  return reach < kFirstHalfOverflow ? bound + kHalfUnit * reach + 0x1p-24 : kInfinity;
}

Worst worst(const Planes& actual, const Bounded& expected) {
  const Planes& value = expected.value;
  if (actual.c != value.c || actual.h != value.h || actual.w != value.w) {
    throw std::invalid_argument(fmt::format("comparing {} x {} x {} planes with expected {} x {} x {}",
                                            actual.c, actual.h, actual.w, value.c, value.h, value.w));
  }
  Worst result;
  for (int c = 0; c < value.c; ++c) {
    for (int y = 0; y < value.h; ++y) {
      for (int x = 0; x < value.w; ++x) {
        const double bound = expected.bound.at(c, y, x);
        const double ratio = ratio_of(actual.at(c, y, x), value.at(c, y, x), bound);
        result.failures += ratio > 1;
        if (ratio > result.ratio) {
          result = {ratio, c, y, x, actual.at(c, y, x), value.at(c, y, x), bound, result.failures};
        }
      }
    }
  }
  return result;
}

double rms_of_difference(const Planes& a, const Planes& b) {
  if (a.data.size() != b.data.size()) throw std::invalid_argument("RMS of planes of different shapes");
  std::vector<double> squares(a.data.size());
  for (size_t i = 0; i < squares.size(); ++i) {
    const double difference = a.data[i] - b.data[i];
    squares[i] = std::isnan(difference) ? kInfinity : difference * difference;
  }
  const auto end = squares.end() - std::ptrdiff_t(squares.size() / 100);
  std::nth_element(squares.begin(), end, squares.end());
  return squares.empty() ? 0 : std::sqrt(std::reduce(squares.begin(), end) / double(end - squares.begin()));
}

double allowed_rms(const Planes& truth, const Planes& in_floats, Precision precision) {
  double largest = 0;
  for (const double v : truth.data) largest = std::max(largest, std::abs(v));
  return kRmsFactor * rms_of_difference(in_floats, truth) +
         (precision == Precision::kFp16 ? kHalfUnit : kUnit) * largest;
}

std::string text_of(const Worst& at, size_t values) {
  return fmt::format(
      "worst error / bound {:.3g} at c {}, y {}, x {}: {:.9g}, expected {:.9g} within {:.3g}; "
      "{} of {} values are outside",
      at.ratio, at.c, at.y, at.x, at.actual, at.expected, at.bound, at.failures, values);
}

}  // namespace raymeld::reference
