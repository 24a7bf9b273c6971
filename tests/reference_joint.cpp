// The layers of the joint base.
#include <stdexcept>

#include "transfer.h"

namespace raymeld::reference {
namespace {

constexpr double kAlbedoFloor = 0.4, kCompress = 0.2;
constexpr double kAlbedoWidth = 3, kNormalWidth = 1.2, kBrightnessWidth = 0.0667;

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

Element at(const Bounded& x, int c, int y, int column) {
  return {x.value.at(c, y, column), x.bound.at(c, y, column)};
}

// What `formula` makes of elements, in double and in intervals.
template <typename Formula, typename... Elements>
Element evaluate(const Formula& formula, const Elements&... elements) {
  const double value = formula(elements.value...);
  if (!(std::isfinite(elements.bound) && ...)) return {value, std::numeric_limits<double>::infinity()};
  const Interval range = formula(elements.template as<Interval>()...);
  return {value, std::max(range.high - value, value - range.low)};
}

void store(Bounded& result, int c, int y, int x, const Element& element, Precision precision) {
  result.value.at(c, y, x) = element.value;
  result.bound.at(c, y, x) = stored_bound(element.value, element.bound, precision);
}

void expect_shape(const Bounded& x, int c, int h, int w) {
  if (x.value.c == c && x.value.h == h && x.value.w == w) return;
  throw std::invalid_argument("reference: the joint base has another shape");
}

// The mean over the s x s cell, summed in any order.
Element cell_mean(const Bounded& x, int c, int row, int column, int s) {
  Element mean{0, 0};
  double magnitude = 0;
  for (int y = s * row; y < s * (row + 1); ++y) {
    for (int xx = s * column; xx < s * (column + 1); ++xx) {
      const Element one = at(x, c, y, xx);
      mean.value += one.value / (s * s);
      mean.bound += one.bound / (s * s);
      magnitude += (std::abs(one.value) + one.bound) / (s * s);
    }
  }
  mean.bound += gamma(s * s + 5) * magnitude;  // the division takes 2.5 ULP
  return mean;
}

// sum w x / sum w. Weights that are off by e, as much as their ranges allow, move it by sum e |x - mean| /
// sum w, and no weights move it out of what x spans; then 2 n + 6 roundings: of the products, both sums and
// the division.
Element weighted_mean(const std::vector<double>& weights, const std::vector<Interval>& ranges,
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

}  // namespace

Bounded irradiance(const Bounded& lrhs, const Bounded& albedo, Transfer transfer, int scale, double phase,
                   Precision precision) {
  const int h = lrhs.value.h, w = lrhs.value.w;
  expect_shape(lrhs, 3, h, w);
  expect_shape(albedo, 3, scale * h, scale * w);
  Bounded result = exact(Planes(3, h, w));
  const auto formula = [&](const auto& color, const auto& own) {
    return apply(transfer, invert(transfer, color) / (own + kAlbedoFloor));
  };
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const Element own =
            phase > 0 ? cell_mean(albedo, c, y, x, scale) : at(albedo, c, scale * y, scale * x);
        store(result, c, y, x, evaluate(formula, at(lrhs, c, y, x), own), precision);
      }
    }
  }
  return result;
}

Bounded light(const Bounded& color, const Bounded& albedo, const Bounded& irradiance, Transfer transfer,
              int scale, double phase, Precision precision) {
  const int h = color.value.h, w = color.value.w;
  expect_shape(color, 3, h, w);
  expect_shape(albedo, 3, h, w);
  expect_shape(irradiance, 3, h / scale, w / scale);
  const Bounded upsampled = bilinear(irradiance, scale, phase);
  Bounded result = exact(Planes(4, h, w));
  const auto compressed = [&](const auto& color, const auto& albedo) {
    using std::log;
    return log(1 + kCompress * (invert(transfer, color) / (albedo + kAlbedoFloor))) / kCompress;
  };
  const auto luminance = [](const auto& r, const auto& g, const auto& b) {
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      for (int c = 0; c < 3; ++c) {
        store(result, c, y, x, evaluate(compressed, at(color, c, y, x), at(albedo, c, y, x)), precision);
      }
      const Element brightness =
          evaluate(luminance, at(upsampled, 0, y, x), at(upsampled, 1, y, x), at(upsampled, 2, y, x));
      store(result, 3, y, x, brightness, precision);
    }
  }
  return result;
}

Bounded joint_filter(const Bounded& x, const Bounded& albedo, const Bounded& normal,
                     const Bounded& brightness, int step, Precision precision) {
  const int h = x.value.h, w = x.value.w;
  expect_shape(x, 3, h, w);
  expect_shape(albedo, 3, h, w);
  expect_shape(normal, 3, h, w);
  expect_shape(brightness, 1, h, w);
  struct Pixel {
    int y, x;
    bool operator==(const Pixel&) const = default;
  };
  const auto weight = [&]<typename T>(T binomial, const Pixel& p, const Pixel& t) {
    using std::exp;
    if (p == t) return binomial * exp(T(0));
    const auto difference = [&](const Bounded& guide, int c, double width) {
      return square(at(guide, c, t.y, t.x).as<T>() / width - at(guide, c, p.y, p.x).as<T>() / width);
    };
    T distance = difference(brightness, 0, kBrightnessWidth);
    for (int c = 0; c < 3; ++c) {
      distance = distance + difference(albedo, c, kAlbedoWidth) + difference(normal, c, kNormalWidth);
    }
    return binomial * exp(-distance);
  };
  Bounded result = exact(Planes(3, h, w));
  for (int y = 0; y < h; ++y) {
    for (int column = 0; column < w; ++column) {
      std::vector<double> weights;
      std::vector<Interval> ranges;
      std::vector<Element> taps[3];
      for (const int dy : {-1, 0, 1}) {
        for (const int dx : {-1, 0, 1}) {
          const Pixel tap{std::clamp(y + dy * step, 0, h - 1), std::clamp(column + dx * step, 0, w - 1)};
          const double binomial = (dy == 0 ? 0.5 : 0.25) * (dx == 0 ? 0.5 : 0.25);
          weights.push_back(weight(binomial, {y, column}, tap));
          ranges.push_back(weight(Interval(binomial), {y, column}, tap));
          for (int c = 0; c < 3; ++c) taps[c].push_back(at(x, c, tap.y, tap.x));
        }
      }
      for (int c = 0; c < 3; ++c) {
        store(result, c, y, column, weighted_mean(weights, ranges, taps[c]), precision);
      }
    }
  }
  return result;
}

Bounded relight(const Bounded& light, const Bounded& albedo, Transfer transfer, Precision precision) {
  const int h = light.value.h, w = light.value.w;
  expect_shape(light, 3, h, w);
  expect_shape(albedo, 3, h, w);
  Bounded result = exact(Planes(3, h, w));
  const auto formula = [&](const auto& light, const auto& albedo) {
    using std::exp;
    return apply(transfer, (exp(kCompress * light) - 1) / kCompress * (albedo + kAlbedoFloor));
  };
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        store(result, c, y, x, evaluate(formula, at(light, c, y, x), at(albedo, c, y, x)), precision);
      }
    }
  }
  return result;
}

Bounded mix(const Bounded& rec, const Bounded& lrhs, const Bounded& albedo, const Bounded& candidates,
            Transfer transfer, int scale, double phase, Precision precision) {
  const int h = rec.value.h, w = rec.value.w;
  expect_shape(rec, 8, h, w);
  expect_shape(lrhs, 6, h / scale, w / scale);
  expect_shape(albedo, 3, h, w);
  expect_shape(candidates, 9, h, w);
  const Bounded low = bilinear(lrhs, scale, phase);
  const auto relit = [&](const auto& irradiance, const auto& albedo) {
    using std::clamp;
    const auto radiance = clamp(invert(transfer, irradiance), 0.0, kLargestOutput);
    return apply(transfer, radiance * (albedo + kAlbedoFloor));
  };
  const auto softmax = [&]<typename T>(std::vector<T>& weights, int y, int x) {
    using std::exp, std::max;
    for (int i = 3; i < 8; ++i) weights.push_back(at(rec, i, y, x).as<T>());
    T largest = weights[0];
    for (const T& logit : weights) largest = max(largest, logit);
    for (T& weight : weights) weight = exp(weight - largest);
  };
  Bounded result = exact(Planes(3, h, w));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      std::vector<double> weights;
      std::vector<Interval> ranges;
      softmax(weights, y, x);
      softmax(ranges, y, x);
      for (int c = 0; c < 3; ++c) {
        const Element first = at(low, c, y, x);
        const Element second = evaluate(relit, at(low, 3 + c, y, x), at(albedo, c, y, x));
        const auto candidate = [&](int i) { return at(candidates, 3 * i + c, y, x); };
        const Element mean =
            weighted_mean(weights, ranges, {first, second, candidate(0), candidate(1), candidate(2)});
        const auto sum = [](const auto& mean, const auto& residual) { return mean + residual; };
        store(result, c, y, x, evaluate(sum, mean, at(rec, c, y, x)), precision);
      }
    }
  }
  return result;
}

}  // namespace raymeld::reference
