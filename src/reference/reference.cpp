#include "reference/reference.h"

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>

#include "reference/elements.h"
#include "reference/transfer.h"
#include "reference/winograd.h"

namespace raymeld::reference {
namespace {

struct Sum {
  double value, magnitude, input_error;  // sum wx + b, S = sum |w||x| + |b|, sum |w| bound(x)
};

Sum convolve_at(const Bounded& x, const Conv& conv, int o, int row, int column) {
  const int pad = conv.kernel / 2;
  Sum sum{conv.bias[o], std::abs(conv.bias[o]), 0};
  for (int i = 0; i < conv.in; ++i) {
    for (int ky = 0; ky < conv.kernel; ++ky) {
      for (int kx = 0; kx < conv.kernel; ++kx) {
        const int y = row + ky - pad, x_ = column + kx - pad;
        if (y < 0 || y >= x.value.h || x_ < 0 || x_ >= x.value.w) continue;
        const double w = conv.at(o, i, ky, kx), v = x.value.at(i, y, x_), e = x.bound.at(i, y, x_);
        sum.value += w * v;
        sum.magnitude += std::abs(w) * (std::abs(v) + e);
        sum.input_error += std::abs(w) * e;
      }
    }
  }
  return sum;
}

// Returns the sums without the bias.
Planes sums_in_floats(const Planes& x, const Conv& conv) {
  const int pad = conv.kernel / 2;
  Planes result(conv.out, x.h, x.w);
  for (int o = 0; o < conv.out; ++o) {
    for (int row = 0; row < x.h; ++row) {
      for (int column = 0; column < x.w; ++column) {
        float sum = 0;
        for (int i = 0; i < conv.in; ++i) {
          for (int y = std::max(row - pad, 0); y <= std::min(row + pad, x.h - 1); ++y)
            for (int u = std::max(column - pad, 0); u <= std::min(column + pad, x.w - 1); ++u)
              sum += float(conv.at(o, i, y - row + pad, u - column + pad)) * float(x.at(i, y, u));
        }
        result.at(o, row, column) = sum;
      }
    }
  }
  return result;
}

void relu_in_place(double& value, double& bound) {
  if (value - bound < -double(FLT_MAX)) {
    if (std::isfinite(value)) bound = std::numeric_limits<double>::infinity();
    return;
  }
  bound = value + bound <= 0 ? 0 : value < 0 ? value + bound : bound;
  if (value < 0) value = 0;
}

double added_bound(double a, double a_bound, double b, double b_bound) {
  const double bound = a_bound + b_bound;
  return bound + kUnit * (std::abs(a + b) + bound);
}

void expect(bool condition, const char* what) {
  if (!condition) throw std::invalid_argument(what);
}

void expect_same_shape(const Planes& a, const Planes& b) {
  expect(a.c == b.c && a.h == b.h && a.w == b.w, "reference: shapes differ");
}

// Kernels in one direction compute no 5x5.
bool is_by_winograd(const Conv& conv, const Tile& tile) {
  return conv.kernel == 3 ? tile != Tile{} : conv.kernel == 5 && tile.down > 1 && tile.across > 1;
}

}  // namespace

Bounded conv2d(const Bounded& x, const Conv& conv, bool relu, Precision precision,
               const std::vector<const Bounded*>& residuals, const Tile& tile, int units) {
  expect(conv.kernel == 1 || conv.kernel == 3 || conv.kernel == 5, "conv2d: the kernel is not 1, 3 or 5");
  expect(conv.in == x.value.c, "conv2d: the input has another number of channels");
  expect(conv.weight.size() == size_t(conv.out) * conv.in * conv.kernel * conv.kernel, "conv2d: weights");
  expect(conv.bias.size() == size_t(conv.out), "conv2d: bias");
  const bool by_winograd = is_by_winograd(conv, tile);
  // In 16 bits the last channel of each of two inputs may be taken twice, see conv2d.comp.
  const int channels = precision == Precision::kFp16 ? conv.in + 2 : conv.in;
  const int n = by_winograd ? winograd_roundings(conv, tile) : channels * conv.kernel * conv.kernel + 1;
  const Planes magnitudes = by_winograd ? winograd_magnitudes(x, conv, tile) : Planes();
  Bounded result = exact(Planes(conv.out, x.value.h, x.value.w));
  for (const Bounded* residual : residuals) expect_same_shape(residual->value, result.value);
  for (int o = 0; o < conv.out; ++o) {
    for (int y = 0; y < x.value.h; ++y) {
      for (int column = 0; column < x.value.w; ++column) {
        const Sum sum = convolve_at(x, conv, o, y, column);
        const double magnitude =
            by_winograd ? magnitudes.at(o, y, column) + std::abs(conv.bias[size_t(o)]) : sum.magnitude;
        double value = sum.value, bound = sum.input_error + gamma(units * n) * magnitude + n * kFlush;
        if (relu) relu_in_place(value, bound);
        for (const Bounded* residual : residuals) {
          const double r = residual->value.at(o, y, column);
          bound = added_bound(value, bound, r, residual->bound.at(o, y, column));
          value += r;
        }
        result.value.at(o, y, column) = value;
        result.bound.at(o, y, column) = stored_bound(value, bound, precision);
      }
    }
  }
  return result;
}

Planes conv2d_in_floats(const Planes& x, const Conv& conv, bool relu, Precision precision,
                        const std::vector<const Planes*>& residuals, const Tile& tile) {
  const bool by_winograd = is_by_winograd(conv, tile);
  Planes result = by_winograd ? winograd_in_floats(x, conv, tile) : sums_in_floats(x, conv);
  for (int o = 0; o < conv.out; ++o) {
    for (int y = 0; y < x.h; ++y) {
      for (int column = 0; column < x.w; ++column) {
        float sum = float(result.at(o, y, column)) + float(conv.bias[size_t(o)]);
        if (relu && sum < 0) sum = 0;
        for (const Planes* residual : residuals) sum += float(residual->at(o, y, column));
        result.at(o, y, column) = round_to(sum, precision);
      }
    }
  }
  return result;
}

Planes concat(Planes a, const Planes& b) {
  expect(a.h == b.h && a.w == b.w, "concat: sizes differ");
  a.c += b.c;
  a.data.insert(a.data.end(), b.data.begin(), b.data.end());
  return a;
}

Bounded concat(const Bounded& a, const Bounded& b) {
  return {concat(a.value, b.value), concat(a.bound, b.bound)};
}

Bounded slice(const Bounded& x, int first, int count) {
  expect(first >= 0 && first + count <= x.value.c, "slice: no such channels");
  const auto cut = [&](const Planes& from) {
    const auto begin = from.data.begin() + ptrdiff_t(from.index(first, 0, 0));
    return Planes(count, from.h, from.w, {begin, begin + ptrdiff_t(from.index(count, 0, 0))});
  };
  return {cut(x.value), cut(x.bound)};
}

Bounded space_to_depth(const Bounded& x, int r) {
  expect(x.value.h % r == 0 && x.value.w % r == 0, "space_to_depth: the size is no multiple");
  const auto move = [&](const Planes& from) {
    Planes to(from.c * r * r, from.h / r, from.w / r);
    for (int c = 0; c < from.c; ++c) {
      for (int y = 0; y < from.h; ++y) {
        for (int x = 0; x < from.w; ++x) {
          to.at(c * r * r + r * (y % r) + x % r, y / r, x / r) = from.at(c, y, x);
        }
      }
    }
    return to;
  };
  return {move(x.value), move(x.bound)};
}

Bounded pixel_shuffle(const Bounded& x, int r) {
  expect(x.value.c % (r * r) == 0, "pixel_shuffle: the channels are no multiple");
  const auto move = [&](const Planes& from) {
    Planes to(from.c / (r * r), from.h * r, from.w * r);
    for (int c = 0; c < to.c; ++c) {
      for (int y = 0; y < to.h; ++y) {
        for (int x = 0; x < to.w; ++x) {
          to.at(c, y, x) = from.at(c * r * r + r * (y % r) + x % r, y / r, x / r);
        }
      }
    }
    return to;
  };
  return {move(x.value), move(x.bound)};
}

namespace {

// An exposure other than 1 rounds once, its square twice.
Bounded encode(const Bounded& image, LayerKind kind, Transfer transfer, double clip, Precision precision,
               double exposure) {
  const bool radiance = kind == LayerKind::kRadiance || kind == LayerKind::kVariance;
  const double low = kind == LayerKind::kNormal ? -1 : 0, high = radiance ? clip : 1;
  const double factor = !radiance ? 1 : kind == LayerKind::kVariance ? exposure * exposure : exposure;
  Bounded result = image;
  for (size_t i = 0; i < result.value.data.size(); ++i) {
    double &value = result.value.data[i], &bound = result.bound.data[i];
    const double scaled = std::isnan(value) ? 0 : value * factor;
    double off = bound * factor * (1 + gamma(2));
    off += factor == 1 || std::isinf(scaled) ? 0 : gamma(2) * std::abs(scaled) + kFlush;
    if (std::abs(value) < kFlush) off += std::abs(scaled);  // a subnormal may be flushed as it is read
    const double least = std::clamp(scaled - off, low, high), most = std::clamp(scaled + off, low, high);
    const Transfer curve = radiance ? transfer : Transfer::kLinear;
    const Interval range = apply(curve, Interval(least, most));
    value = apply(curve, std::clamp(scaled, low, high));
    bound = std::max(range.high - value, value - range.low);
    bound = stored_bound(value, bound, precision);
  }
  return result;
}

// The mean of nine values rounds at most ten times, and the sum of nine squared differences from it thirteen
// times. A mean that is off by d adds d^2 to the variance, as the differences from the right one sum up to 0.
void variance_at(const Planes& color, int c, int y, int x, Bounded& to) {
  std::array<double, 9> values;
  double sum = 0, magnitude = 0;
  for (int i = 0; i < 9; ++i) {
    const int near_y = std::clamp(y + i / 3 - 1, 0, color.h - 1),
              near_x = std::clamp(x + i % 3 - 1, 0, color.w - 1);
    const double value = color.at(c, near_y, near_x);
    values[size_t(i)] = std::isfinite(value) ? value : 0;
    sum += values[size_t(i)];
    magnitude += std::abs(values[size_t(i)]);
  }
  double squares = 0;
  for (const double value : values) squares += (value - sum / 9) * (value - sum / 9);
  const double off = gamma(10) * magnitude / 9 + 9 * kFlush;
  to.value.at(c, y, x) = squares / 9;
  to.bound.at(c, y, x) = off * off + gamma(13) * (squares / 9 + off * off) + 9 * kFlush;
}

}  // namespace

Bounded encode(const Planes& image, LayerKind kind, Transfer transfer, double clip, Precision precision,
               double exposure) {
  return encode(exact(image), kind, transfer, clip, precision, exposure);
}

Bounded variance(const Planes& color, Transfer transfer, double clip, Precision precision, double exposure) {
  Bounded result = exact(color);
  for (int c = 0; c < color.c; ++c)
    for (int y = 0; y < color.h; ++y)
      for (int x = 0; x < color.w; ++x) variance_at(color, c, y, x, result);
  return encode(result, LayerKind::kVariance, transfer, clip, precision, exposure);
}

// The factors are multiples of 1 / (2 s) and exact. Each of three interpolations rounds at most three times,
// on values that are no larger than the largest sample.
Bounded bilinear(const Bounded& x, int scale, double phase) {
  const int h = x.value.h, w = x.value.w;
  Bounded result = exact(Planes(x.value.c, h * scale, w * scale));
  for (int c = 0; c < x.value.c; ++c) {
    for (int out_y = 0; out_y < h * scale; ++out_y) {
      for (int out_x = 0; out_x < w * scale; ++out_x) {
        double value = 0, bound = 0, largest = 0;
        for (const Corner& s : corners(x, c, out_y, out_x, scale, phase)) {
          value += s.factor * s.value;
          bound += s.factor * s.bound;
          largest = std::max(largest, std::abs(s.value) + s.bound);
        }
        result.value.at(c, out_y, out_x) = value;
        result.bound.at(c, out_y, out_x) = bound + gamma(9) * largest;
      }
    }
  }
  return result;
}

Bounded above_clip(const Planes& image, double clip, Precision precision, double exposure) {
  Bounded result = exact(image);
  for (size_t i = 0; i < image.data.size(); ++i) {
    double &value = result.value.data[i], &bound = result.bound.data[i];
    // The limits keep infinity - infinity out of the intervals; other finite ones would do as well.
    const double x = std::isnan(value) ? 0 : std::clamp(value, -kLargestOutput, 1e30);
    value = std::clamp(x - clip / exposure, 0.0, kLargestOutput);
    const Interval range =
        clamp(Interval(x, x) - Interval(clip) / Interval(exposure, exposure), 0, kLargestOutput);
    bound = stored_bound(value, std::max(range.high - value, value - range.low), precision);
  }
  return result;
}

namespace {

// Returns the range of a mean of numbers that are not negative and weighted by themselves. It ends at the
// largest of them, and starts at 0 where the sum of the weights may be 0.
Interval self_weighted_range(std::span<const Corner> samples) {
  Interval weights(0), products(0);
  double largest = 0;
  for (const auto& [factor, value, bound] : samples) {
    const Interval sample(std::max(0.0, value - bound), value + bound), weight = Interval(factor) * sample;
    weights = weights + weight;
    products = products + weight * sample;
    if (factor > 0) largest = std::max(largest, sample.high);
  }
  largest *= 1 + gamma(9);
  if (weights.low < 0x1p-100) return {0, largest};
  const Interval mean = products / weights;
  return {std::max(0.0, mean.low), std::min(mean.high, largest)};
}

}  // namespace

Bounded self_weighted(const Bounded& x, int scale, double phase) {
  const int h = x.value.h, w = x.value.w;
  Bounded result = exact(Planes(x.value.c, h * scale, w * scale));
  for (int c = 0; c < x.value.c; ++c) {
    for (int y = 0; y < h * scale; ++y) {
      for (int column = 0; column < w * scale; ++column) {
        const auto samples = corners(x, c, y, column, scale, phase);
        double weights = 0, products = 0;
        for (const Corner& s : samples)
          weights += s.factor * s.value, products += s.factor * s.value * s.value;
        const double value = weights > 0 ? products / weights : 0;
        const Interval range = self_weighted_range(samples);
        result.value.at(c, y, column) = value;
        result.bound.at(c, y, column) = std::max({range.high - value, value - range.low, 0.0});
      }
    }
  }
  return result;
}

// The device multiplies by the exposure's inverse, which rounds no more than a division does. An inverse of 1
// does not round.
Bounded decode(const Bounded& rec, const Bounded* base, Transfer transfer, Precision precision,
               double exposure, const Bounded* above_clip, double clip) {
  Bounded result = rec;
  if (base) expect_same_shape(base->value, rec.value);
  if (above_clip) expect_same_shape(above_clip->value, rec.value);
  for (size_t i = 0; i < rec.value.data.size(); ++i) {
    double &value = result.value.data[i], &bound = result.bound.data[i];
    if (base) {
      bound = added_bound(value, bound, base->value.data[i], base->bound.data[i]);
      value += base->value.data[i];
    }
    if (!std::isfinite(bound)) continue;
    const auto curve = [&](const auto& y, const auto& above) {
      using std::clamp;
      const auto x = invert(transfer, y);
      auto linear = exposure == 1 ? x : x / exposure;
      if (above_clip) linear = linear + clamp(8 * x / clip - 1, 0.0, 1.0) * above;
      return clamp(linear, 0.0, kLargestOutput);
    };
    const double above = above_clip ? above_clip->value.data[i] : 0;
    const double off = above_clip ? above_clip->bound.data[i] : 0;
    const Interval range =
        curve(Interval(value - bound, value + bound), Interval(std::max(0.0, above - off), above + off));
    value = curve(value, above);
    bound = stored_bound(value, std::max(range.high - value, value - range.low), precision);
  }
  return result;
}

}  // namespace raymeld::reference
