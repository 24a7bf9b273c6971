#include "fusion/pair.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <tuple>
#include <vector>

#include "error.h"

namespace raymeld {
namespace {

constexpr int kSide = 8;  // side of a block in LRHS samples
constexpr size_t kArea = size_t(kSide) * kSide;
constexpr int kMostBlocks = 512;
constexpr float kBrightest = 4;     // an HRLS pixel brighter than this times LRHS around it is a firefly
constexpr double kFloor = 3e-5;     // the least variance that counts, of values up to about 1
constexpr double kRidge = 1e-3;     // shrinks the slopes of images that hardly vary
constexpr double kStructure = 2.5;  // least ratio of a block's variance to that of its noise
constexpr int kFewestBlocks = 8;    // fewest blocks with structure to judge by
constexpr double kColorsShare = 3.0 / 7;            // share of the colors alone in a phase's evidence
constexpr double kForeign = 0.2, kDoubtful = 0.38;  // correlations below these have that relation
constexpr double kOther = 0.5,
                 kGain = 0.35;            // least correlation of a mirrored LRHS, and least gain
constexpr double kLeastBrightness = 0.2;  // factors between e^-0.2 and e^0.2 are taken for 1
constexpr double kBrightnessErrors = 8;   // least ratio of a factor's logarithm to its standard error

using Values = std::array<float, kArea>;

// Holds an image's luminance and, as `key`, the square of its mean square root, which outliers hardly move.
struct Luminance {
  int width, height;
  std::vector<float> values;
  float key;

  explicit Luminance(const Image& image)
      : width(image.width), height(image.height), values(image.plane_size()) {
    double sum = 0;
    for (size_t i = 0; i < values.size(); ++i) {
      const float light =
          0.2126f * image.plane(0)[i] + 0.7152f * image.plane(1)[i] + 0.0722f * image.plane(2)[i];
      values[i] = std::max(light, 0.0f);
      sum += std::sqrt(values[i]);
    }
    const double mean = sum / double(values.size());
    key = float(std::max(mean * mean, 1e-12));
  }
  // Replicates the edges.
  float at(int x, int y) const {
    return values[size_t(std::clamp(y, 0, height - 1)) * size_t(width) + size_t(std::clamp(x, 0, width - 1))];
  }
};

// Returns (H, W), the largest value in each pixel's 3x3 neighbourhood.
std::vector<float> brightest_around(const Luminance& image) {
  std::vector<float> most(image.values.size());
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      float value = 0;
      for (int v = y - 1; v <= y + 1; ++v)
        for (int u = x - 1; u <= x + 1; ++u) value = std::max(value, image.at(u, v));
      most[size_t(y) * size_t(image.width) + size_t(x)] = value;
    }
  }
  return most;
}

float log_curve(float light, float key) { return 0.5f * std::log1p(light / key); }

// Returns a Gaussian around `centre`, at the taps from -reach to scale + reach - 1. Both phases have the same
// width and so the same noise: only the place of LRHS decides between them.
std::vector<float> taps_around(float centre, int scale, int reach) {
  const float sigma = std::max(0.5f * float(scale), 0.8f);
  std::vector<float> taps(size_t(scale + 2 * reach));
  float sum = 0;
  for (size_t i = 0; i < taps.size(); ++i) {
    const float x = (float(i) - float(reach) - centre) / sigma;
    sum += taps[i] = std::exp(-0.5f * x * x);
  }
  for (float& tap : taps) tap /= sum;
  return taps;
}

// Holds the sums of squares and products of two blocks' differences from their means.
struct Moments {
  double xx = 0, xy = 0, yy = 0;

  Moments(const Values& x, const Values& y) {
    double mean_x = 0, mean_y = 0;
    for (size_t i = 0; i < kArea; ++i) mean_x += x[i] / double(kArea), mean_y += y[i] / double(kArea);
    for (size_t i = 0; i < kArea; ++i) {
      const double dx = x[i] - mean_x, dy = y[i] - mean_y;
      xx += dx * dx, xy += dx * dy, yy += dy * dy;
    }
  }
  double correlation() const { return xy / std::sqrt(xx * yy); }
};

// Returns the sum of squares that the best linear combination of `images` and a constant leaves of `y`.
double residual(std::span<Values> images, Values y) {
  const auto centre = [](Values& values) {
    const float mean = std::accumulate(values.begin(), values.end(), 0.0f) / float(kArea);
    for (float& value : values) value -= mean;
  };
  const auto product = [](const Values& a, const Values& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
  };
  centre(y);
  for (Values& image : images) centre(image);
  // Each image in turn is subtracted from later images and from y, as far as it explains them.
  for (size_t i = 0; i < images.size(); ++i) {
    const double square = product(images[i], images[i]) + kRidge * double(kArea);
    const auto take_from = [&](Values& values) {
      const auto factor = float(product(images[i], values) / square);
      for (size_t k = 0; k < kArea; ++k) values[k] -= factor * images[i][k];
    };
    for (size_t j = i + 1; j < images.size(); ++j) take_from(images[j]);
    take_from(y);
  }
  return product(y, y);
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Examines one pair, block by block.
class Examination {
 public:
  Examination(const Luminance& lrhs, const Luminance& hrls, int scale, std::vector<const float*> guides = {})
      : lrhs_(lrhs),
        hrls_(hrls),
        guides_(std::move(guides)),
        scale_(scale),
        reach_(std::max(3 * scale / 2, 3)),
        side_(kSide * scale + 2 * reach_),
        limits_(brightest_around(lrhs)),
        nearest_(taps_around(0, scale, reach_)),
        centered_(taps_around(float(scale - 1) / 2, scale, reach_)),
        pixels_(size_t(side_) * size_t(side_)),
        rows_(size_t(side_) * kSide) {
    const float allowed = kBrightest * hrls.key / lrhs.key;
    for (float& limit : limits_) limit = allowed * limit + 0.01f * hrls.key;
    for (int p = 0; p < side_; ++p) samples_.push_back(sample_of(p - reach_));
  }

  // Returns the log-likelihood ratio of both phases: HRLS is blurred for each, and the blurred planes are
  // combined linearly in each block to come near LRHS. Colors count by themselves as well as with the guides:
  // a shadow beside an edge of the normals is better explained by a guide that is misplaced, and each such
  // edge errs alike.
  double phase_evidence() {
    double evidence = 0;
    std::vector<Values> images[2];
    for_blocks([&](int x, int y) {
      for (auto& phase : images) phase.clear();
      const auto add_both = [&] {
        images[0].push_back(filtered(nearest_));
        images[1].push_back(filtered(centered_));
      };
      gather(x, y);
      add_both();
      for (auto& phase : images)
        for (float& value : phase.front()) value = log_curve(value, hrls_.key);
      for (const float* guide : guides_) {
        gather(guide, x, y);
        add_both();
      }
      const Values lrhs = lrhs_block(x, y);
      const auto ratio = [&](size_t count) {
        const double floor = kFloor * double(kArea);
        const double nearest = residual(std::span(images[0]).first(count), lrhs),
                     centered = residual(std::span(images[1]).first(count), lrhs);
        return double(kArea) / 2 * std::log((nearest + floor) / (centered + floor));
      };
      const double colors = ratio(1);
      evidence += kColorsShare * colors + (1 - kColorsShare) * ratio(images[0].size());
    });
    return evidence;
  }

  // Returns the correlation of LRHS with HRLS's means at its size in blocks where HRLS is more than noise.
  std::vector<double> correlations() const {
    std::vector<double> found;
    for_blocks([&](int x, int y) {
      Values means{};
      const double noise = hrls_means(x, y, means);
      const Moments moments(means, bounded_block(x, y));
      const double floor = kFloor * double(kArea);
      if (moments.xx > kStructure * noise * double(kArea) + floor && moments.yy > floor)
        found.push_back(moments.correlation());
    });
    return found;
  }

  // Returns the logarithm of the ratio of HRLS's light, without its fireflies, to LRHS's for each block that
  // has light.
  std::vector<double> light_ratios() const {
    std::vector<double> ratios;
    for_blocks([&](int x, int y) {
      double low = 0, full = 0;
      for (int v = 0; v < kSide; ++v)
        for (int u = 0; u < kSide; ++u) low += lrhs_.at(x + u, y + v);
      for (int v = 0; v < kSide * scale_; ++v) {
        const size_t row = size_t(y + v / scale_) * size_t(lrhs_.width) + size_t(x);
        for (int u = 0; u < kSide * scale_; ++u)
          full += std::min(hrls_.at(x * scale_ + u, y * scale_ + v), limits_[row + size_t(u / scale_)]);
      }
      low /= double(kArea), full /= double(kArea) * scale_ * scale_;
      if (low > 0.05 * lrhs_.key && full > 0.05 * hrls_.key) ratios.push_back(std::log(full / low));
    });
    return ratios;
  }

 private:
  // Visits at most kMostBlocks whole blocks, spread over the frame, by the coordinates of their first sample.
  template <typename Visit>
  void for_blocks(const Visit& visit) const {
    const int64_t across = lrhs_.width / kSide, count = across * (lrhs_.height / kSide);
    const int64_t visited = std::min<int64_t>(count, kMostBlocks);
    for (int64_t i = 0; i < visited; ++i) {
      const int64_t block = i * count / visited;
      visit(int(block % across) * kSide, int(block / across) * kSide);
    }
  }

  // Returns the LRHS sample nearest to a pixel of HRLS, at a phase half way between both to favour neither.
  int sample_of(int pixel) const {
    return int(std::floor((float(pixel) - float(scale_ - 1) / 4) / float(scale_) + 0.5f));
  }

  // Gathers HRLS around a block, without its fireflies.
  void gather(int x0, int y0) {
    for (int y = 0; y < side_; ++y) {
      const int row = std::clamp(y0 + samples_[size_t(y)], 0, lrhs_.height - 1);
      for (int x = 0; x < side_; ++x) {
        const int column = std::clamp(x0 + samples_[size_t(x)], 0, lrhs_.width - 1);
        pixels_[size_t(y * side_ + x)] =
            std::min(hrls_.at(x0 * scale_ - reach_ + x, y0 * scale_ - reach_ + y),
                     limits_[size_t(row) * size_t(lrhs_.width) + size_t(column)]);
      }
    }
  }

  // Gathers a guide around a block.
  void gather(const float* guide, int x0, int y0) {
    for (int y = 0; y < side_; ++y) {
      const int row = std::clamp(y0 * scale_ - reach_ + y, 0, hrls_.height - 1);
      for (int x = 0; x < side_; ++x) {
        const int column = std::clamp(x0 * scale_ - reach_ + x, 0, hrls_.width - 1);
        pixels_[size_t(y * side_ + x)] = guide[size_t(row) * size_t(hrls_.width) + size_t(column)];
      }
    }
  }

  Values filtered(const std::vector<float>& taps) {
    Values values{};
    for (int y = 0; y < side_; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const float* from = &pixels_[size_t(y * side_ + x * scale_)];
        float sum = 0;
        for (size_t i = 0; i < taps.size(); ++i) sum += taps[i] * from[i];
        rows_[size_t(y * kSide + x)] = sum;
      }
    }
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        float sum = 0;
        for (size_t i = 0; i < taps.size(); ++i)
          sum += taps[i] * rows_[(size_t(y * scale_) + i) * kSide + size_t(x)];
        values[size_t(y * kSide + x)] = sum;
      }
    }
    return values;
  }

  Values lrhs_block(int x, int y) const {
    Values values{};
    for (size_t i = 0; i < kArea; ++i)
      values[i] = log_curve(lrhs_.at(x + int(i) % kSide, y + int(i) / kSide), lrhs_.key);
    return values;
  }

  static float bounded(float light, float key) { return light / (light + key); }

  Values bounded_block(int x, int y) const {
    Values values{};
    for (size_t i = 0; i < kArea; ++i)
      values[i] = bounded(lrhs_.at(x + int(i) % kSide, y + int(i) / kSide), lrhs_.key);
    return values;
  }

  // Computes the means of the HRLS pixels of each LRHS sample, each pixel in [0, 1) so that no firefly counts
  // for more than one. Returns the variance of such a mean, estimated from how neighbouring pixels differ.
  double hrls_means(int x0, int y0, Values& means) const {
    const int side = kSide * scale_;
    const float share = 1 / float(scale_ * scale_);
    double squares = 0;
    for (int y = 0; y < side; ++y) {
      float last = 0;
      for (int x = 0; x < side; ++x) {
        const float value = bounded(hrls_.at(x0 * scale_ + x, y0 * scale_ + y), hrls_.key);
        means[size_t(y / scale_ * kSide + x / scale_)] += value * share;
        if (x > 0) squares += (value - last) * (value - last);
        last = value;
      }
    }
    return squares / (2.0 * side * (side - 1)) * share;
  }

  const Luminance &lrhs_, &hrls_;
  std::vector<const float*> guides_;
  int scale_, reach_, side_;
  std::vector<float> limits_;
  std::vector<int> samples_;
  std::vector<float> nearest_, centered_, pixels_, rows_;
};

Luminance turned(Luminance image, bool mirrored, bool flipped) {
  const auto width = std::ptrdiff_t(image.width);
  if (mirrored)
    for (auto row = image.values.begin(); row != image.values.end(); row += width)
      std::reverse(row, row + width);
  if (flipped)
    for (std::ptrdiff_t y = 0; y < image.height / 2; ++y)
      std::swap_ranges(image.values.begin() + y * width, image.values.begin() + (y + 1) * width,
                       image.values.begin() + (image.height - 1 - y) * width);
  return image;
}

// Returns how LRHS must be mirrored or turned to resemble HRLS much more, else kForeign or kDoubtful.
Relation relation_of(const Luminance& lrhs, const Luminance& hrls, int scale, double correlation) {
  Relation relation = correlation < kForeign ? Relation::kForeign : Relation::kDoubtful;
  double best = std::max(kOther, correlation + kGain);
  for (const auto& [mirrored, flipped, named] : {std::tuple(true, false, Relation::kMirrored),
                                                 {false, true, Relation::kFlipped},
                                                 {true, true, Relation::kTurned}}) {
    std::vector<double> found = Examination(turned(lrhs, mirrored, flipped), hrls, scale).correlations();
    if (found.size() < kFewestBlocks || median(found) < best) continue;
    best = median(found);
    relation = named;
  }
  return relation;
}

// Returns e to the median where that is beyond the blocks' disagreement, else 1.
float brightness_of(std::vector<double> ratios) {
  if (ratios.size() < size_t(kFewestBlocks)) return 1;
  const double middle = median(ratios);
  for (double& ratio : ratios) ratio = std::abs(ratio - middle);
  const double error = 1.4826 * 1.2533 * median(ratios) / std::sqrt(double(ratios.size()));
  if (std::abs(middle) < kLeastBrightness || std::abs(middle) < kBrightnessErrors * error) return 1;
  return float(std::exp(middle));
}

}  // namespace

PairFindings examine_pair(const Image& lrhs_image, const Image& hrls_image, int scale,
                          std::span<const int> guides) {
  if (hrls_image.width != scale * lrhs_image.width || hrls_image.height != scale * lrhs_image.height)
    throw Error("LRHS is {} x {} and HRLS is {} x {}, expected HRLS to be {} times as wide and high",
                lrhs_image.width, lrhs_image.height, hrls_image.width, hrls_image.height, scale);
  const Luminance lrhs(lrhs_image), hrls(hrls_image);
  std::vector<const float*> planes;
  for (const int guide : guides) planes.push_back(hrls_image.plane(guide));
  Examination examination(lrhs, hrls, scale, std::move(planes));
  PairFindings found;
  found.phase_evidence = examination.phase_evidence();
  std::vector<double> correlations = examination.correlations();
  found.structured = int(correlations.size());
  if (found.structured >= kFewestBlocks) {
    found.correlation = median(correlations);
    found.relation =
        found.correlation >= kDoubtful ? Relation::kSame : relation_of(lrhs, hrls, scale, found.correlation);
  }
  if (!found.is_refused()) found.brightness = brightness_of(examination.light_ratios());
  return found;
}

}  // namespace raymeld
