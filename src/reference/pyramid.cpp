// Computes the layers of a pyramid network.
#include "reference/elements.h"

namespace raymeld::reference {
namespace {

constexpr auto compressed = [](const auto& x) {
  using std::log;
  return log(1 + kCompress * x) / kCompress;
};

constexpr double kAlbedoAffinity = 6.25, kNormalAffinity = 2.25;

// Holds a pixel's side x side weights, the softmax of its logits from `first` on, not yet divided by their
// sum. With guides, the factors of their differences are the two logits from `factors` on.
class Kernel {
 public:
  Kernel(const Bounded& logits, int first, int side, int y, int x, const Bounded* guides = nullptr,
         int factors = 0)
      : logits_(logits), guides_(guides), first_(first), factors_(factors), side_(side), y_(y), x_(x) {
    softmax(weights_);
    softmax(ranges_);
  }

  // Returns the mean of channel c.
  Element mean(const Bounded& image, int c) const {
    std::vector<Element> elements;
    for (int i = 0; i < side_ * side_; ++i) {
      const auto [y, x] = tap(i);
      elements.push_back(at(image, c, y, x));
    }
    return weighted_mean(weights_, ranges_, elements);
  }

 private:
  std::pair<int, int> tap(int i) const {
    return {std::clamp(y_ + i / side_ - side_ / 2, 0, logits_.value.h - 1),
            std::clamp(x_ + i % side_ - side_ / 2, 0, logits_.value.w - 1)};
  }

  // Returns what the difference of three channels from `channel` on takes from the logit of a tap.
  template <typename T>
  T unlikeness(double affinity, int channel, int factor, int i) const {
    using std::exp, std::clamp;
    const auto [y, x] = tap(i);
    const T logit = at(logits_, factors_ + factor, y_, x_).as<T>();
    T sum = 0;
    for (int c = channel; c < channel + 3; ++c)
      sum = sum + square(T(at(*guides_, c, y_, x_).as<T>() - at(*guides_, c, y, x).as<T>()));
    return affinity * exp(clamp(logit, -6.0, 6.0)) * sum;
  }

  template <typename T>
  void softmax(std::vector<T>& weights) const {
    using std::exp, std::max;
    for (int i = 0; i < side_ * side_; ++i) {
      T logit = at(logits_, first_ + i, y_, x_).as<T>();
      const bool is_own = tap(i) == std::pair(y_, x_);
      if (guides_ && !is_own)
        logit = logit - (unlikeness<T>(kAlbedoAffinity, 0, 0, i) + unlikeness<T>(kNormalAffinity, 3, 1, i));
      weights.push_back(logit);
    }
    T largest = weights[0];
    for (const T& logit : weights) largest = max(largest, logit);
    for (T& weight : weights) weight = exp(weight - largest);
  }

  const Bounded& logits_;
  const Bounded* guides_;
  int first_, factors_, side_, y_, x_;
  std::vector<double> weights_;
  std::vector<Interval> ranges_;
};

}  // namespace

Bounded light(const Bounded& color, const Bounded& albedo, Transfer transfer, Precision precision,
              const std::optional<Decimated>& decimated) {
  const int h = color.value.h, w = color.value.w;
  expect_shape(color, 3, h, w);
  expect_shape(albedo, 3, h, w);
  if (decimated) expect_shape(decimated->lrhs, 3, h / decimated->scale, w / decimated->scale);
  Bounded result = exact(Planes(3, h, w));
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const auto formula = [&]<typename T>(T) -> T {
          const T radiance =
              firefly_limit<T>(color, transfer, y, x) * invert(transfer, at(color, c, y, x).as<T>());
          const T surface = at(albedo, c, y, x).as<T>() + kAlbedoFloor, own = radiance / surface;
          if (!decimated || y % decimated->scale != 0 || x % decimated->scale != 0) return compressed(own);
          const auto& [lrhs, scale, certainty] = *decimated;
          const T given = invert(transfer, at(lrhs, c, y / scale, x / scale).as<T>()) / surface;
          return compressed(T((own + certainty * given) / T(1 + certainty)));
        };
        store(result, c, y, x, evaluate_in_both(formula), precision);
      }
    }
  }
  return result;
}

Bounded cell_light(const Bounded& lrhs, const Bounded& albedo, Transfer transfer, int scale, double phase,
                   Precision precision) {
  const int h = lrhs.value.h, w = lrhs.value.w;
  expect_shape(lrhs, 3, h, w);
  expect_shape(albedo, 3, scale * h, scale * w);
  const auto formula = [&](const auto& color, const auto& own) {
    return compressed(invert(transfer, color) / (own + kAlbedoFloor));
  };
  Bounded result = exact(Planes(3, h, w));
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const Element own = mean_of_covered(albedo, c, y, x, scale, phase > 0 ? scale : 1);
        store(result, c, y, x, evaluate(formula, at(lrhs, c, y, x), own), precision);
      }
    }
  }
  return result;
}

Bounded pool(const Bounded& x, Precision precision, const Bounded* other, double share,
             const Bounded* shares) {
  const int channels = x.value.c, h = x.value.h / 2, w = x.value.w / 2;
  expect_shape(x, std::max(channels, 9), 2 * h, 2 * w);
  if (other) expect_shape(*other, 3, h, w);
  if (shares) expect_shape(*shares, 1, h, w);
  const auto moved_by = [](const auto& mean, const auto& to, const auto& by) {
    return mean + by * (to - mean);
  };
  const auto moved = [&](const auto& mean, const auto& to) { return mean + share * (to - mean); };
  Bounded result = exact(Planes(9, h, w));
  for (int c = 0; c < 9; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int column = 0; column < w; ++column) {
        const Element mean = mean_of_covered(x, c < 3 ? c : c + channels - 9, y, column, 2, 2);
        Element value = mean;
        if (c < 3 && shares) {
          value = evaluate(moved_by, mean, at(*other, c, y, column), at(*shares, 0, y, column));
        } else if (c < 3 && other) {
          value = evaluate(moved, mean, at(*other, c, y, column));
        }
        store(result, c, y, column, value, precision);
      }
    }
  }
  return result;
}

Bounded kernel_filter(const Bounded& x, const Bounded& logits, int side, Precision precision,
                      const Bounded* coarse, const Bounded* guides) {
  const int h = x.value.h, w = x.value.w;
  expect_shape(x, 3, h, w);
  const int taps = side * side, factors = taps + (coarse ? 1 : 0);
  expect_shape(logits, factors + (guides ? 2 : 0), h, w);
  if (guides) expect_shape(*guides, 6, h, w);
  if (coarse) expect_shape(*coarse, 3, h / 2, w / 2);
  const Bounded upsampled = coarse ? bilinear(*coarse, 2, 0.5) : Bounded{};
  const auto blended = [](const auto& mean, const auto& low, const auto& logit) {
    return mean + sigmoid(logit) * (low - mean);
  };
  Bounded result = exact(Planes(3, h, w));
  for (int y = 0; y < h; ++y) {
    for (int column = 0; column < w; ++column) {
      const Kernel kernel(logits, 0, side, y, column, guides, factors);
      for (int c = 0; c < 3; ++c) {
        Element value = kernel.mean(x, c);
        if (coarse)
          value = evaluate(blended, value, at(upsampled, c, y, column), at(logits, taps, y, column));
        store(result, c, y, column, value, precision);
      }
    }
  }
  return result;
}

Bounded compose(const Bounded& rec, const Bounded& light, const Bounded& guides, const Bounded& lrhs,
                Transfer transfer, int scale, double phase, Precision precision) {
  const int h = rec.value.h, w = rec.value.w;
  expect_shape(rec, 15, h, w);
  expect_shape(light, 3, h, w);
  expect_shape(guides, 6, h, w);
  expect_shape(lrhs, 3, h / scale, w / scale);
  const Bounded low = bilinear(lrhs, scale, phase);
  // No device makes light or albedo negative, as means of what is not negative.
  const auto formula = [&]<typename T>(const T& residual, const T& logit, const T& compressed,
                                       const T& surface, const T& base) -> T {
    using std::exp, std::max;
    const T x = max((exp(kCompress * compressed) - 1) / kCompress, T(0));
    return residual + base +
           sigmoid(logit) * (apply(transfer, x * (max(surface, T(0)) + kAlbedoFloor)) - base);
  };
  Bounded result = exact(Planes(3, h, w));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const Kernel kernel(rec, 4, 3, y, x, &guides, 13);
      for (int c = 0; c < 3; ++c) {
        store(result, c, y, x,
              evaluate(formula, at(rec, c, y, x), at(rec, 3, y, x), at(light, c, y, x),
                       kernel.mean(guides, c), at(low, c, y, x)),
              precision);
      }
    }
  }
  return result;
}

}  // namespace raymeld::reference
