#include "io/image.h"

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>

#include "error.h"

namespace raymeld {
namespace {

// Holds which four samples of a row one output reads, and their weights.
struct Taps {
  std::array<int, 4> index;
  std::array<float, 4> weight;
};

Taps cubic_taps(float position, int size) {
  const float base = std::floor(position);
  const float t = position - base;
  Taps taps;
  taps.weight = {((-0.5f * t + 1.0f) * t - 0.5f) * t, (1.5f * t - 2.5f) * t * t + 1.0f,
                 ((-1.5f * t + 2.0f) * t + 0.5f) * t, (0.5f * t - 0.5f) * t * t};
  for (int i = 0; i < 4; ++i) taps.index[i] = std::clamp(int(base) - 1 + i, 0, size - 1);
  return taps;
}

Taps linear_taps(float position, int size) {
  Taps taps = cubic_taps(position, size);
  const float t = position - std::floor(position);
  taps.weight = {0, 1 - t, t, 0};
  return taps;
}

std::vector<Taps> all_taps(int size, int scale, float phase, Taps taps_at(float, int)) {
  std::vector<Taps> taps;
  taps.reserve(size_t(size) * size_t(scale));
  for (int i = 0; i < size * scale; ++i) taps.push_back(taps_at((float(i) - phase) / float(scale), size));
  return taps;
}

template <typename Row>
float blend(const Taps& taps, Row&& row) {
  float sum = 0;
  for (int i = 0; i < 4; ++i) sum += taps.weight[i] * row(taps.index[i]);
  return sum;
}

Image upsample(const Image& image, int scale, float phase, Taps taps_at(float, int)) {
  if (scale < 1) throw Error("cannot upsample by {}: the scale must be at least 1", scale);
  const std::vector<Taps> columns = all_taps(image.width, scale, phase, taps_at);
  const std::vector<Taps> rows = all_taps(image.height, scale, phase, taps_at);
  Image wide(image.width * scale, image.height, image.channels);
  Image result(image.width * scale, image.height * scale, image.channels);
  for (int c = 0; c < image.channels; ++c) {
    for (int y = 0; y < wide.height; ++y)
      for (int x = 0; x < wide.width; ++x)
        wide.at(c, y, x) = blend(columns[x], [&](int from) { return image.at(c, y, from); });
    for (int y = 0; y < result.height; ++y)
      for (int x = 0; x < result.width; ++x)
        result.at(c, y, x) = blend(rows[y], [&](int from) { return wide.at(c, from, x); });
  }
  return result;
}

double finite_or_zero(float value) { return std::isfinite(value) ? double(value) : 0.0; }

float variance_at(const Image& image, int c, int y, int x) {
  std::array<double, 9> values;
  double sum = 0;
  for (int i = 0; i < 9; ++i) {
    const int near_y = std::clamp(y + i / 3 - 1, 0, image.height - 1);
    const int near_x = std::clamp(x + i % 3 - 1, 0, image.width - 1);
    values[i] = finite_or_zero(image.at(c, near_y, near_x));
    sum += values[i];
  }
  const double mean = sum / 9;
  double squares = 0;
  for (double value : values) squares += (value - mean) * (value - mean);
  return float(std::min(squares / 9, double(FLT_MAX)));
}

}  // namespace

Image::Image(int width, int height, int channels) : width(width), height(height), channels(channels) {
  if (width <= 0 || height <= 0 || channels <= 0)
    throw Error("cannot make an image of {} x {} pixels with {} channels: each must be at least 1", width,
                height, channels);
  data.resize(plane_size() * size_t(channels));
}

Image first_channels(const Image& image, int count) {
  Image first(image.width, image.height, count);
  std::copy_n(image.data.begin(), first.data.size(), first.data.begin());
  return first;
}

Image upsample_bicubic(const Image& image, int scale, float phase) {
  return upsample(image, scale, phase, cubic_taps);
}

Image upsample_bilinear(const Image& image, int scale, float phase) {
  return upsample(image, scale, phase, linear_taps);
}

float linear_to_srgb(float linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 1;
  return linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
}

NonFinite sanitize(Image& image) {
  NonFinite found;
  for (float& value : image.data) {
    if (std::isnan(value)) {
      value = 0;
      ++found.nan;
    } else if (std::isinf(value)) {
      value = std::copysign(kLargestHalf, value);
      ++found.inf;
    }
  }
  return found;
}

Image variance_3x3(const Image& image) {
  Image variance(image.width, image.height, image.channels);
  for (int c = 0; c < image.channels; ++c)
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x < image.width; ++x) variance.at(c, y, x) = variance_at(image, c, y, x);
  return variance;
}

}  // namespace raymeld
