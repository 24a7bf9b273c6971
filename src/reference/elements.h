// Evaluates formulas of elements with their bounds, and has what several layers of images share.
#pragma once

#include <array>
#include <stdexcept>
#include <type_traits>

#include "reference/transfer.h"

namespace raymeld::reference {

inline constexpr double kAlbedoFloor = 0.4, kCompress = 0.2;
inline constexpr double kFirefly = 20, kFireflyFloor = 1e-3;

struct Element {
  double value, bound;

  template <typename T>
  T as() const {
    if constexpr (std::is_same_v<T, Interval>)
      return {value - bound, value + bound};
    else
      return value;
  }
};

inline Element at(const Bounded& x, int c, int y, int column) {
  return {x.value.at(c, y, column), x.bound.at(c, y, column)};
}

// Returns a value with the bound that its interval sets.
inline Element within(double value, const Interval& range) {
  if (!std::isfinite(range.low) || !std::isfinite(range.high)) {
    return {value, std::numeric_limits<double>::infinity()};
  }
  return {value, std::max(range.high - value, value - range.low)};
}

// Evaluates `formula` in double and in intervals. It is called with a value of the type to compute in.
template <typename Formula>
Element evaluate_in_both(const Formula& formula) {
  return within(formula(double()), formula(Interval(0)));
}

// Evaluates `formula` of elements.
template <typename Formula, typename... Elements>
Element evaluate(const Formula& formula, const Elements&... elements) {
  if (!(std::isfinite(elements.bound) && ...)) {
    return {formula(elements.value...), std::numeric_limits<double>::infinity()};
  }
  return evaluate_in_both([&]<typename T>(T) -> T { return formula(elements.template as<T>()...); });
}

inline void store(Bounded& result, int c, int y, int x, const Element& element, Precision precision) {
  result.value.at(c, y, x) = element.value;
  result.bound.at(c, y, x) = stored_bound(element.value, element.bound, precision);
}

inline void expect_shape(const Bounded& x, int c, int h, int w) {
  if (x.value.c == c && x.value.h == h && x.value.w == w) return;
  throw std::invalid_argument("reference: an image of another shape than expected");
}

// Holds one of the four samples that a pixel lies between.
struct Corner {
  double factor, value, bound;
};

// Returns the samples of a channel around a full-size pixel, of an image that is `scale` times as small.
inline std::array<Corner, 4> corners(const Bounded& x, int c, int out_y, int out_x, int scale, double phase) {
  const int h = x.value.h, w = x.value.w;
  const double v = std::clamp((out_y - phase) / scale, 0.0, h - 1.0);
  const double u = std::clamp((out_x - phase) / scale, 0.0, w - 1.0);
  const int y0 = int(v), x0 = int(u);
  std::array<Corner, 4> result;
  for (const int i : {0, 1, 2, 3}) {
    const int dy = i / 2, dx = i % 2, y = std::min(y0 + dy, h - 1), xx = std::min(x0 + dx, w - 1);
    const double factor = (dy ? v - y0 : 1 - (v - y0)) * (dx ? u - x0 : 1 - (u - x0));
    result[size_t(i)] = {factor, x.value.at(c, y, xx), x.bound.at(c, y, xx)};
  }
  return result;
}

// Returns the mean over h x w pixels from (top, left) on. The sum and the division take so
// many roundings.
inline Element mean_over(const Bounded& x, int c, int top, int left, int h, int w, int roundings) {
  Element mean{0, 0};
  double magnitude = 0;
  for (int y = top; y < top + h; ++y) {
    for (int column = left; column < left + w; ++column) {
      const Element one = at(x, c, y, column);
      mean.value += one.value / (h * w);
      mean.bound += one.bound / (h * w);
      magnitude += (std::abs(one.value) + one.bound) / (h * w);
    }
  }
  mean.bound += gamma(roundings) * magnitude;
  return mean;
}

// Returns the mean over the side x side pixels from the first one on of the s x s that an LRHS pixel covers;
// the division takes 2.5 ULP.
inline Element mean_of_covered(const Bounded& x, int c, int row, int column, int s, int side) {
  return mean_over(x, c, s * row, s * column, side, side, side * side + 5);
}

// Returns sum w x / sum w. Weights that are off by e, the most that their ranges allow, move it by at most
// sum e |x - mean| / sum w, and no weights move it out of the span of x. The products, both sums and the
// division add 2 n + 6 roundings.
inline Element weighted_mean(const std::vector<double>& weights, const std::vector<Interval>& ranges,
                             const std::vector<Element>& x) {
  double sum = 0, least_sum = 0, value = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    sum += weights[i];
    least_sum += ranges[i].low;
    value += weights[i] * x[i].value;
  }
  value /= sum;
  double moved = 0, span = 0, largest = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    const double off = std::max(ranges[i].high - weights[i], weights[i] - ranges[i].low);
    const double away = std::abs(x[i].value - value);
    moved += off * away + ranges[i].high * x[i].bound;
    span = std::max(span, away + x[i].bound);
    largest = std::max(largest, std::abs(x[i].value) + x[i].bound);
  }
  const int n = int(x.size());
  return {value, std::min(span, moved / least_sum) + gamma(2 * n + 6) * largest + 8 * n * kFlush};
}

// Returns the share that a logit stands for. Shaders limit it to 80, where exp does not overflow.
inline constexpr auto sigmoid = [](const auto& logit) {
  using std::exp, std::clamp;
  return 1 / (1 + exp(-clamp(logit, -80.0, 80.0)));
};

inline constexpr auto luminance = [](const auto& r, const auto& g, const auto& b) {
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};

// Returns the luminance of linear radiance at a pixel, which is 0 outside the image.
template <typename T>
T brightness_at(const Bounded& color, Transfer transfer, int y, int x) {
  if (y < 0 || x < 0 || y >= color.value.h || x >= color.value.w) return 0;
  const auto channel = [&](int c) { return invert(transfer, at(color, c, y, x).as<T>()); };
  return luminance(channel(0), channel(1), channel(2));
}

// Returns the factor that limits the brightness of a firefly; it is 1 for other pixels.
template <typename T>
T firefly_limit(const Bounded& color, Transfer transfer, int y, int x) {
  using std::min, std::max;
  T first = 0, second = 0;
  for (const int dy : {-1, 0, 1}) {
    for (const int dx : {-1, 0, 1}) {
      if (dy == 0 && dx == 0) continue;
      const T near = brightness_at<T>(color, transfer, y + dy, x + dx);
      second = max(second, min(first, near));
      first = max(first, near);
    }
  }
  const T own = brightness_at<T>(color, transfer, y, x), floor = kFireflyFloor;
  return min(T(1), (kFirefly * second + floor) / max(own, floor));
}

}  // namespace raymeld::reference
