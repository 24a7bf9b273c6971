// Computes the layers of the joint base.
#include "reference/elements.h"

namespace raymeld::reference {
namespace {

constexpr double kAlbedoWidth = 1.5, kNormalWidth = 1.2, kBrightnessWidth = 0.0667;

struct Pixel {
  int y, x;
  bool operator==(const Pixel&) const = default;
};

struct Guide {
  const Bounded& image;
  double width;
};

// Holds the 3x3 pixels at distances of `step` around a pixel, and their weights, binomial * exp(-d^2).
struct Taps {
  std::vector<double> weights;
  std::vector<Interval> ranges;
  std::vector<Pixel> pixels;

  Taps(const std::vector<Guide>& guides, const Pixel& own, int step) {
    const int h = guides[0].image.value.h, w = guides[0].image.value.w;
    const auto weight = [&]<typename T>(T binomial, const Pixel& tap) {
      using std::exp;
      if (own == tap) return binomial * exp(T(0));
      T distance = 0;
      for (const Guide& guide : guides) {
        for (int c = 0; c < guide.image.value.c; ++c) {
          distance = distance + square(at(guide.image, c, tap.y, tap.x).as<T>() / guide.width -
                                       at(guide.image, c, own.y, own.x).as<T>() / guide.width);
        }
      }
      return binomial * exp(-distance);
    };
    for (const int dy : {-1, 0, 1}) {
      for (const int dx : {-1, 0, 1}) {
        const Pixel tap{std::clamp(own.y + dy * step, 0, h - 1), std::clamp(own.x + dx * step, 0, w - 1)};
        const double binomial = (dy == 0 ? 0.5 : 0.25) * (dx == 0 ? 0.5 : 0.25);
        weights.push_back(weight(binomial, tap));
        ranges.push_back(weight(Interval(binomial), tap));
        pixels.push_back(tap);
      }
    }
  }

  std::vector<Element> of(const Bounded& x, int c) const {
    std::vector<Element> elements;
    for (const Pixel& tap : pixels) elements.push_back(at(x, c, tap.y, tap.x));
    return elements;
  }
  Element mean(const Bounded& x, int c) const { return weighted_mean(weights, ranges, of(x, c)); }

  // Returns taps whose weights are multiplied by the elements of channel c.
  Taps times(const Bounded& x, int c) const {
    Taps result = *this;
    const std::vector<Element> factors = of(x, c);
    for (size_t i = 0; i < factors.size(); ++i) {
      result.weights[i] = weights[i] * factors[i].value;
      result.ranges[i] = ranges[i] * factors[i].as<Interval>();
    }
    return result;
  }
};

// Samples a full-size image at all LRHS pixels.
Bounded sampled_by_lrhs(const Bounded& image, int scale, double phase) {
  Bounded result = exact(Planes(image.value.c, image.value.h / scale, image.value.w / scale));
  for (int c = 0; c < result.value.c; ++c) {
    for (int y = 0; y < result.value.h; ++y) {
      for (int x = 0; x < result.value.w; ++x) {
        const Element own = sampled_by_lrhs(image, c, y, x, scale, phase);
        result.value.at(c, y, x) = own.value;
        result.bound.at(c, y, x) = own.bound;
      }
    }
  }
  return result;
}

}  // namespace

Bounded irradiance(const Bounded& lrhs, const Bounded& albedo, const Bounded& normal, Transfer transfer,
                   int scale, double phase, Precision precision) {
  const int h = lrhs.value.h, w = lrhs.value.w;
  expect_shape(lrhs, 3, h, w);
  expect_shape(albedo, 3, scale * h, scale * w);
  expect_shape(normal, 3, scale * h, scale * w);
  const Bounded own_albedo = sampled_by_lrhs(albedo, scale, phase),
                own_normal = sampled_by_lrhs(normal, scale, phase);
  const auto formula = [&](const auto& color, const auto& own) {
    return apply(transfer, invert(transfer, color) / (own + kAlbedoFloor));
  };
  Bounded demodulated = exact(Planes(3, h, w)), result = demodulated;
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const Element own = evaluate(formula, at(lrhs, c, y, x), at(own_albedo, c, y, x));
        demodulated.value.at(c, y, x) = own.value;
        demodulated.bound.at(c, y, x) = own.bound;
      }
    }
  }
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const Taps taps({{own_albedo, kAlbedoWidth}, {own_normal, kNormalWidth}}, {y, x}, 1);
      for (int c = 0; c < 3; ++c) store(result, c, y, x, taps.mean(demodulated, c), precision);
    }
  }
  return result;
}

Bounded demodulate(const Bounded& color, const Bounded& albedo, const Bounded& lrhs, double certainty,
                   Transfer transfer, int scale, double phase, Precision precision) {
  const int h = color.value.h, w = color.value.w;
  expect_shape(color, 3, h, w);
  expect_shape(albedo, 3, h, w);
  expect_shape(lrhs, 6, h / scale, w / scale);
  const bool centered = phase > 0;
  const Bounded upsampled = bilinear(lrhs, scale, phase);
  const auto lrhs_counts = [&](int y, int x) {
    if (centered) return certainty / (scale * scale);
    return y % scale == 0 && x % scale == 0 ? certainty : 0;
  };
  const auto demodulated = [&]<typename T>(T, int c, int y, int x) {
    using std::log, std::clamp;
    const T surface = at(albedo, c, y, x).as<T>() + kAlbedoFloor;
    T radiance =
        firefly_limit<T>(color, transfer, y, x) * invert(transfer, at(color, c, y, x).as<T>()) / surface;
    if (const double counts = lrhs_counts(y, x); counts > 0) {
      const T given =
          centered ? T(clamp(invert(transfer, at(upsampled, 3 + c, y, x).as<T>()), 0.0, kLargestOutput))
                   : T(invert(transfer, at(lrhs, c, y / scale, x / scale).as<T>()) / surface);
      radiance = (radiance + counts * given) / T(1 + counts);
    }
    return T(log(1 + kCompress * radiance) / kCompress);
  };
  Bounded result = exact(Planes(5, h, w));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      for (int c = 0; c < 3; ++c) {
        store(result, c, y, x, evaluate_in_both([&](auto type) { return demodulated(type, c, y, x); }),
              precision);
      }
      const double counts = lrhs_counts(y, x);
      store(result, 3, y, x, {1 + counts, kUnit * counts}, precision);
      const Element brightness =
          evaluate(luminance, at(upsampled, 3, y, x), at(upsampled, 4, y, x), at(upsampled, 5, y, x));
      store(result, 4, y, x, brightness, precision);
    }
  }
  return result;
}

Bounded joint_filter(const Bounded& x, const Bounded& albedo, const Bounded& normal,
                     const Bounded& brightness, int step, Precision precision, const GuideFactors& factors) {
  const int h = x.value.h, w = x.value.w;
  expect_shape(x, 4, h, w);
  expect_shape(albedo, 3, h, w);
  expect_shape(normal, 3, h, w);
  expect_shape(brightness, 1, h, w);
  const std::vector<Guide> guides{{albedo, kAlbedoWidth / factors[0]},
                                  {normal, kNormalWidth / factors[1]},
                                  {brightness, kBrightnessWidth / factors[2]}};
  Bounded result = exact(Planes(4, h, w));
  for (int y = 0; y < h; ++y) {
    for (int column = 0; column < w; ++column) {
      const Taps taps(guides, {y, column}, step), certain = taps.times(x, 3);
      for (int c = 0; c < 3; ++c) store(result, c, y, column, certain.mean(x, c), precision);
      store(result, 3, y, column, taps.mean(x, 3), precision);
    }
  }
  return result;
}

Bounded remodulate(const Bounded& demodulated, const Bounded& albedo, Transfer transfer, Precision precision,
                   const Bounded* rest) {
  const int h = demodulated.value.h, w = demodulated.value.w;
  expect_shape(demodulated, 3, h, w);
  expect_shape(albedo, 3, h, w);
  Bounded result = exact(Planes(3, h, w));
  if (rest) expect_shape(*rest, 3, h, w);
  const auto radiance = [](const auto& compressed, const auto& own) {
    using std::exp;
    return (exp(kCompress * compressed) - 1) / kCompress * (own + kAlbedoFloor);
  };
  const auto formula = [&](const auto& compressed, const auto& own) {
    return apply(transfer, radiance(compressed, own));
  };
  const auto sum = [&](const auto& compressed, const auto& own, const auto& added) {
    return apply(transfer, radiance(compressed, own) + invert(transfer, added));
  };
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const Element light = at(demodulated, c, y, x), own = at(albedo, c, y, x);
        store(result, c, y, x,
              rest ? evaluate(sum, light, own, at(*rest, c, y, x)) : evaluate(formula, light, own),
              precision);
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
  const auto remodulated = [&](const auto& irradiance, const auto& albedo) {
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
        const Element second = evaluate(remodulated, at(low, 3 + c, y, x), at(albedo, c, y, x));
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
