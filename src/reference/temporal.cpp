// Computes the layers that join a frame with the ones before it.
#include <array>
#include <optional>

#include "reference/elements.h"

namespace raymeld::reference {
namespace {

constexpr double kMostFrames = 63, kMostLrhsFrames = 15, kMostSamples = 16;
constexpr double kSharpenedShare = 0.25;
constexpr double kHistoryAlbedo = 40, kHistoryNormal = 10, kHistoryDepth = 40;
constexpr double kDepthTolerance = 0.05, kDepthMotion = 0.25;
constexpr double kHistoryMotion = 16, kHistorySteady = 0.05;
constexpr double kNowhere = 1e9;  // a motion that leads out of the frame
constexpr double kLightFloor = 0.02, kLightNoise = 0.01, kLightErrors = 1.85;
constexpr double kLightSpread = 2, kLightMostVariance = 12, kLightOutlier = 2, kLightFirst = 0.002;
constexpr double kLightChange = 8, kLightLarge = 20, kLightMost = 1;
constexpr double kUnknownVariance = 1e30;
constexpr double kLeastWeight = 1e-6, kLeastSquare = 1e-12;
constexpr double kSettled = 0.6, kSettledBlur = 0.8, kSettledMargin = 1.01;

struct Tap {
  int y, x;
  double weight;
};

// Returns the pixels around (y, x) with their bilinear weights; a pixel outside the frame has none.
std::array<Tap, 4> taps_at(double y, double x, int h, int w) {
  std::array<Tap, 4> taps;
  const bool known = std::isfinite(y) && std::isfinite(x);
  y = known ? std::clamp(y, -2.0, h + 1.0) : -2;
  x = known ? std::clamp(x, -2.0, w + 1.0) : -2;
  const int top = int(std::floor(y)), left = int(std::floor(x));
  const double down = y - top, right = x - left;
  for (int i = 0; i < 4; ++i) {
    Tap& tap = taps[size_t(i)];
    tap = {top + i / 2, left + i % 2, (i / 2 ? down : 1 - down) * (i % 2 ? right : 1 - right)};
    if (tap.y < 0 || tap.x < 0 || tap.y >= h || tap.x >= w) tap = {0, 0, 0};
  }
  return taps;
}

// Returns the pixels of the last frame around the point that full-size pixel (y, x) shows.
std::array<Tap, 4> taps_before(const Past& past, int y, int x) {
  return taps_at(y + past.y + past.motion.at(1, y, x), x + past.x + past.motion.at(0, y, x), past.hrls.h,
                 past.hrls.w);
}

// Returns how much reading blurs: 0 at a pixel, 3/4 in the middle of four.
double blur_of(const std::array<Tap, 4>& taps) {
  double blur = 1;
  for (const Tap& tap : taps) blur -= tap.weight * tap.weight;
  return blur;
}

struct Range {
  double low, high;
};

// Returns whether LRHS's history has a frame at a point.
bool is_known(const Past& past, const std::array<Tap, 4>& taps) {
  return std::ranges::any_of(
      taps, [&](const Tap& tap) { return tap.weight > 0 && past.lrhs.at(5, tap.y, tap.x) > 0; });
}

// Returns the range of a channel's 3x3 pixels around one.
Range range_around(const Bounded& image, int c, int y, int x) {
  Range range{image.value.at(c, y, x), image.value.at(c, y, x)};
  for (int dy : {-1, 0, 1}) {
    for (int dx : {-1, 0, 1}) {
      const double value = image.value.at(c, std::clamp(y + dy, 0, image.value.h - 1),
                                          std::clamp(x + dx, 0, image.value.w - 1));
      range = {std::min(range.low, value), std::max(range.high, value)};
    }
  }
  return range;
}

// Returns the squared distance of a value from a range.
template <typename T>
T beyond(const T& value, const Range& range) {
  using std::max;
  return square(T(max(value - range.high, T(0)) + max(range.low - value, T(0))));
}

// Holds the bilinear mean of a history's planes where some pixels count less.
template <typename T>
struct Read {
  std::vector<T> planes;
  T weight = 0, frames = 0;
};

// Reads `planes` planes of a history, of which the last one counts frames. count(tap) says how much a pixel
// counts.
template <typename T, typename Count>
Read<T> read(const Planes& history, int planes, const std::array<Tap, 4>& taps, const Count& count) {
  using std::max;
  Read<T> result;
  std::array<T, 4> weights{0, 0, 0, 0};
  for (size_t i = 0; i < taps.size(); ++i) {
    const auto& [y, x, weight] = taps[i];
    const double frames = history.at(history.c - 1, y, x);
    if (weight == 0 || frames == 0) continue;
    weights[i] = T(weight) * count(taps[i]);
    result.weight = result.weight + weights[i];
    result.frames = result.frames + weights[i] * T(frames);
  }
  for (int c = 0; c < planes; ++c) {
    T sum = 0;
    for (size_t i = 0; i < taps.size(); ++i)
      sum = sum + weights[i] / max(result.weight, T(kLeastWeight)) * T(history.at(c, taps[i].y, taps[i].x));
    result.planes.push_back(sum);
  }
  return result;
}

// Returns half of the mean squared difference of 3x3 values whose places differ by (dy, dx), or
// kUnknownVariance where no two such are known.
template <typename T>
T variance_along(const std::array<T, 9>& values, const std::array<bool, 9>& known, int dy, int dx) {
  T sum = 0;
  int count = 0;
  for (int i = 0; i < 9; ++i) {
    const int y = i / 3 + dy, x = i % 3 + dx, other = 3 * y + x;
    if (y > 2 || x < 0 || x > 2 || !known[size_t(i)] || !known[size_t(other)]) continue;
    sum = sum + square(T(values[size_t(other)] - values[size_t(i)]));
    count += 2;
  }
  return count > 0 ? T(sum / T(count)) : T(kUnknownVariance);
}

// Returns the variance in that of four directions where it is least.
template <typename T>
T variance_of(const std::array<T, 9>& values, const std::array<bool, 9>& known) {
  using std::min;
  T variance = variance_along(values, known, 0, 1);
  for (const int dx : {0, 1, -1}) variance = min(variance, variance_along(values, known, 1, dx));
  return variance;
}

// Returns the luminance of the 3x3 pixels around one.
template <typename T>
std::array<T, 9> luminances_around(const Bounded& lrhs, Transfer transfer, int y, int x) {
  std::array<T, 9> result{0, 0, 0, 0, 0, 0, 0, 0, 0};
  for (int i = 0; i < 9; ++i) {
    const int row = std::clamp(y + i / 3 - 1, 0, lrhs.value.h - 1);
    const int column = std::clamp(x + i % 3 - 1, 0, lrhs.value.w - 1);
    const auto channel = [&](int c) { return invert(transfer, at(lrhs, c, row, column).as<T>()); };
    result[size_t(i)] = luminance(channel(0), channel(1), channel(2));
  }
  return result;
}

// Holds what light_change() says of a pixel; see its shader.
template <typename T>
struct Change {
  T light = 0, left = 0, residual = 0;
};

// Returns the change of the 3x3 pixels around one, which have these luminances, since the last frames.
// (row, column) is where the pixel was; of it the history knows so many `frames`, this deviation and what was
// `corrected` already.
template <typename T>
Change<T> change_of(const std::array<T, 9>& lights, const Past& past, double row, double column,
                    const T& frames, const T& deviation, const T& corrected) {
  using std::clamp, std::log, std::max, std::min, std::sqrt;
  std::array<T, 9> changes{0, 0, 0, 0, 0, 0, 0, 0, 0};
  std::array<bool, 9> known{};
  T now = 0, before = 0, spread = 0;
  for (int i = 0; i < 9; ++i) {
    const int dy = i / 3 - 1, dx = i % 3 - 1;
    const auto taps = taps_at(row + dy, column + dx, past.lrhs.h, past.lrhs.w);
    known[size_t(i)] = is_known(past, taps);
    if (!known[size_t(i)]) continue;
    const Read<T> then = read<T>(past.lrhs, 4, taps, [](const Tap&) { return T(1); });
    const T light = lights[size_t(i)];
    const T past_light = luminance(then.planes[0], then.planes[1], then.planes[2]) * T(past.exposure);
    now = now + light;
    before = before + past_light;
    spread = spread + square(T(then.planes[3] * T(past.exposure)));
    changes[size_t(i)] = light - past_light;
  }
  const auto count = double(std::ranges::count(known, true));
  if (count < 2) return {corrected, corrected, deviation};
  now = now / T(count);
  before = before / T(count);
  T variance = variance_of(changes, known);
  variance = min(T(max(T(kLightSpread) * spread / T(count), variance)), T(T(kLightMostVariance) * variance));
  const T error = T(kLightErrors) * sqrt(T(variance / T(count))) / (min(now, before) + kLightFloor);
  const T change = log(T(now + kLightFloor)) - log(T(before + kLightFloor));
  const T squared = max(square(change), T(kLeastSquare));
  const T share = max(T(1 - square(T(error + kLightNoise)) / squared),
                      T(clamp(T(corrected * change / squared), 0.0, 1.0)));
  const T joined = (frames * before + now) / (frames + 1);
  const T left = log(T(now + kLightFloor)) - log(T(joined + kLightFloor)), away = changes[4] - (now - before);
  return {share * change, share * left, max(away, T(T(0) - away))};
}

// Returns what light_change() returns for a pixel.
template <typename T>
std::array<T, 8> light_change_at(const Bounded& lrhs, const Past& past, Transfer transfer, int scale, int y,
                                 int x) {
  using std::max, std::min, std::sqrt;
  double down = 0, right = 0;
  for (int i = 0; i < scale * scale; ++i) {
    right += past.motion.at(0, scale * y + i / scale, scale * x + i % scale);
    down += past.motion.at(1, scale * y + i / scale, scale * x + i % scale);
  }
  const double cubed = scale * scale * scale;
  const double row = y + past.y / scale + down / cubed, column = x + past.x / scale + right / cubed;
  const auto taps = taps_at(row, column, past.lrhs.h, past.lrhs.w);
  const Read<T> before = read<T>(past.lrhs, 5, taps, [](const Tap&) { return T(1); });
  const T mean = before.planes[3] * T(past.exposure), corrected = before.planes[4];
  const T frames = min(before.frames, T(kMostLrhsFrames));
  const std::array<T, 9> lights = luminances_around<T>(lrhs, transfer, y, x);
  const Change<T> change = change_of<T>(lights, past, row, column, frames, mean, corrected);
  const T most = T(kLightOutlier) * mean + T(kLightFirst) / max(T(frames - 1), T(kLeastWeight));
  const bool known = is_known(past, taps);
  std::array<bool, 9> all{};
  all.fill(true);
  const T deviation = known ? T(mean + (min(change.residual, most) - mean) / max(frames, T(1)))
                            : sqrt(T(T(kLightSpread) * variance_of(lights, all)));
  const T up = max(change.light, T(0)) - max(corrected, T(0));
  const T falling = max(T(T(0) - change.light), T(0)) - max(T(T(0) - corrected), T(0));
  std::array<T, 8> result{change.light - corrected, max(T(max(up, falling)), T(0)), 0, 0, 0, 0, 0, 0};
  for (int c = 0; c < 3; ++c) {
    const T value = invert(transfer, at(lrhs, c, y, x).as<T>());
    const T known_value = before.planes[size_t(c)] * T(past.exposure);
    const T joined = known ? T((frames * known_value + value) / (frames + 1)) : value;
    result[size_t(c) + 2] = joined * T(1 / past.exposure);
  }
  result[5] = deviation * T(1 / past.exposure);
  result[6] = change.left;
  result[7] = frames + 1;
  return result;
}

// Holds the factors of a history's radiance and of its frames where the light has changed.
template <typename T>
struct Factors {
  T radiance = 1, frames = 1;
};

// Returns the factors by the changes of the centred LRHS pixels around a full-size one.
template <typename T>
Factors<T> factors_at(const Bounded& changes, int scale, int y, int x) {
  using std::clamp, std::exp, std::max;
  const auto corners_of = [&](int c) { return corners(changes, c, y, x, scale, (scale - 1) / 2.0); };
  T most = 0, mean = 0;
  for (const Corner& light : corners_of(0))
    mean = mean + T(light.factor) * Element{light.value, light.bound}.as<T>();
  for (const Corner& grown : corners_of(1)) most = max(most, Element{grown.value, grown.bound}.as<T>());
  return {exp(clamp(mean, -kLightMost, kLightMost)),
          exp(T(0) - most * (T(kLightChange) + T(kLightLarge) * most))};
}

bool is_depth(double depth) { return depth > 0 && std::isfinite(depth); }

// Holds depths around a pixel in this frame, and that of the pixel in both frames.
struct Depths {
  Range now;
  double own, before;

  // Returns the squared distance of a depth in the last frame from the range, by logarithms.
  template <typename T>
  T beyond(double depth) const {
    using std::log, std::max;
    const T since = log(T(before)) - log(T(own)), other = log(T(depth));
    const T high = log(T(now.high)) + since + kDepthTolerance,
            low = log(T(now.low)) + since - kDepthTolerance;
    return square(T(max(T(other - high), T(0)) + max(T(low - other), T(0))));
  }
};

// Returns the depths of a pixel and of those of the four beside it that move with it, or nothing where its
// own is not known.
std::optional<Depths> depths_around(const Past& past, int y, int x) {
  const Planes& motion = past.motion;
  if (motion.c < 4 || !is_depth(motion.at(2, y, x)) || !is_depth(motion.at(3, y, x))) return std::nullopt;
  Range depths{motion.at(2, y, x), motion.at(2, y, x)};
  for (int i = 1; i < 9; i += 2) {
    const int row = std::clamp(y + i / 3 - 1, 0, motion.h - 1);
    const int column = std::clamp(x + i % 3 - 1, 0, motion.w - 1);
    double away = 0;
    for (int c = 0; c < 2; ++c) away += square(motion.at(c, row, column) - motion.at(c, y, x));
    const double depth = motion.at(2, row, column);
    if (!is_depth(depth) || !(away <= kDepthMotion)) continue;
    depths = {std::min(depths.low, depth), std::max(depths.high, depth)};
  }
  return Depths{depths, motion.at(2, y, x), motion.at(3, y, x)};
}

// Returns what accumulate() returns for a pixel.
template <typename T>
std::vector<T> accumulate_at(const Bounded& hrls, const Past& past, Transfer transfer, double clip,
                             double spp, const Factors<T>& factors, int y, int x) {
  using std::exp, std::max, std::min, std::log2, std::clamp;
  const int channels = past.hrls.c - 4;
  const std::optional<Depths> depths = depths_around(past, y, x);
  const auto taps = taps_before(past, y, x);
  std::array<double, 2> motion{past.motion.at(0, y, x), past.motion.at(1, y, x)};
  if (!std::isfinite(motion[0]) || !std::isfinite(motion[1])) motion = {kNowhere, kNowhere};
  const auto likeness = [&](const Tap& tap) {
    T albedo = 0, normal = 0;
    for (int c = 3; c < 9; ++c) {
      T& sum = c < 6 ? albedo : normal;
      sum = sum + beyond<T>(T(past.hrls.at(c, tap.y, tap.x)), range_around(hrls, c, y, x));
    }
    T moved = 0;
    for (int c = 0; c < 2; ++c)
      moved = moved + square(T(T(past.hrls.at(channels + c, tap.y, tap.x)) - T(motion[size_t(c)])));
    const T steady = exp(T(-kHistoryMotion) * moved) * T(1 - blur_of(taps));
    T unlike = T(kHistoryAlbedo) * albedo + T(kHistoryNormal) * normal;
    if (const double depth = past.hrls.at(channels + 2, tap.y, tap.x); depths && is_depth(depth))
      unlike = unlike + T(kHistoryDepth) * depths->beyond<T>(depth);
    return T(exp(-(1 - steady + T(kHistorySteady) * steady) * unlike));
  };
  const Read<T> before = read<T>(past.hrls, channels, taps, likeness);
  const T frames = min(before.frames * factors.frames, T(kMostFrames)), share = 1 / (frames + 1);
  const T guide_share = max(share, T(std::min(blur_of(taps) / 2, kSharpenedShare)));
  const T firefly = firefly_limit<T>(hrls, transfer, y, x);
  std::vector<T> joined, encoded;
  for (int c = 0; c < channels; ++c) {
    const bool is_radiance = c < 3 || c >= 9;
    T value = at(hrls, c, y, x).as<T>(), then = before.planes[size_t(c)];
    if (is_radiance) {
      value = invert(transfer, value);
      then = then * T(past.exposure) * factors.radiance;
    }
    if (c < 3) value = value * firefly / (at(hrls, c + 3, y, x).as<T>() + kAlbedoFloor);
    joined.push_back(is_radiance ? T(share * (frames * then + value))
                                 : T(then + guide_share * (value - then)));
  }
  for (int c = 0; c < channels; ++c) {
    T value = joined[size_t(c)];
    if (c < 3) value = value * (joined[size_t(c) + 3] + kAlbedoFloor);
    encoded.push_back(c < 3 || c >= 9 ? apply(transfer, T(min(value, T(clip)))) : value);
  }
  encoded.push_back(log2(T(clamp(T((frames + 1) * T(spp)), 1.0, kMostSamples))));
  for (int c = 0; c < channels; ++c)
    encoded.push_back(c < 3 || c >= 9 ? T(joined[size_t(c)] * T(1 / past.exposure)) : joined[size_t(c)]);
  for (const double along : motion) encoded.push_back(T(along));
  encoded.push_back(T(past.motion.c < 4 ? 0 : past.motion.at(2, y, x)));
  encoded.push_back(frames + 1);
  return encoded;
}

// Returns what settle() returns for a pixel.
template <typename T>
std::array<T, 6> settle_at(const Bounded& fused, const Bounded& samples, const Past& past, Transfer transfer,
                           double clip, double spp, int y, int x) {
  using std::clamp, std::exp2, std::max, std::min;
  const auto taps = taps_before(past, y, x);
  double known = 0;
  for (const Tap& tap : taps) known += tap.weight;
  const T now = T(spp) / exp2(at(samples, 0, y, x).as<T>());
  const T sharp = 1 - T(kSettledBlur) * T(blur_of(taps)), old = max(T(1 - T(kSettledMargin) * now), T(0));
  const T share = known > 0 ? T(T(kSettled) * sharp * old) : T(0);
  std::array<T, 6> result{0, 0, 0, 0, 0, 0};
  for (int c = 0; c < 3; ++c) {
    T then = 0;
    for (const Tap& tap : taps) then = then + T(tap.weight) * T(past.fused.at(c, tap.y, tap.x));
    then = then * T(past.exposure) / T(std::max(known, kLeastWeight));
    then = apply(transfer, T(clamp(then, 0.0, clip)));
    const Range range = range_around(fused, c, y, x);
    const T value = at(fused, c, y, x).as<T>();
    result[size_t(c)] = value + share * (T(clamp(then, range.low, range.high)) - value);
    result[size_t(c) + 3] = max(invert(transfer, value), T(0)) * T(1 / past.exposure);
  }
  return result;
}

// Stores values of type double with the intervals that they lie in; from channel `wide` on in 32 bits.
void store_all(Bounded& result, int y, int x, const auto& values, const auto& ranges, int wide,
               Precision precision) {
  for (size_t c = 0; c < values.size(); ++c) {
    store(result, int(c), y, x, within(values[c], ranges[c]), int(c) < wide ? precision : Precision::kFp32);
  }
}

}  // namespace

Bounded light_change(const Bounded& lrhs, const Past& past, Transfer transfer, int scale,
                     Precision precision) {
  const int h = lrhs.value.h, w = lrhs.value.w;
  expect_shape(lrhs, 3, h, w);
  Bounded result = exact(Planes(8, h, w));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      store_all(result, y, x, light_change_at<double>(lrhs, past, transfer, scale, y, x),
                light_change_at<Interval>(lrhs, past, transfer, scale, y, x), 2, precision);
    }
  }
  return result;
}

Bounded accumulate(const Bounded& hrls, const Past& past, Transfer transfer, double clip, double spp,
                   Precision precision, const Bounded* change, int scale) {
  const int h = hrls.value.h, w = hrls.value.w, channels = past.hrls.c - 4;
  if (change) expect_shape(*change, 2, h / scale, w / scale);
  Bounded result = exact(Planes(2 * channels + 5, h, w));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const auto result_at = [&]<typename T>(T) {
        const Factors<T> factors = change ? factors_at<T>(*change, scale, y, x) : Factors<T>{};
        return accumulate_at<T>(hrls, past, transfer, clip, spp, factors, y, x);
      };
      store_all(result, y, x, result_at(0.0), result_at(Interval(0)), channels + 1, precision);
    }
  }
  return result;
}

Bounded settle(const Bounded& fused, const Bounded& samples, const Past& past, Transfer transfer, double clip,
               double spp, Precision precision) {
  const int h = fused.value.h, w = fused.value.w;
  expect_shape(fused, 3, h, w);
  expect_shape(samples, 1, h, w);
  Bounded result = exact(Planes(6, h, w));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      store_all(result, y, x, settle_at<double>(fused, samples, past, transfer, clip, spp, y, x),
                settle_at<Interval>(fused, samples, past, transfer, clip, spp, y, x), 3, precision);
    }
  }
  return result;
}

Bounded color_variance(const Bounded& color, Transfer transfer, double clip, Precision precision) {
  const int h = color.value.h, w = color.value.w;
  expect_shape(color, 3, h, w);
  Bounded result = exact(Planes(3, h, w));
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const auto formula = [&]<typename T>(T) -> T {
          using std::min;
          std::vector<T> colors;
          T mean = 0, squares = 0;
          for (int i = 0; i < 9; ++i) {
            const int row = std::clamp(y + i / 3 - 1, 0, h - 1), column = std::clamp(x + i % 3 - 1, 0, w - 1);
            colors.push_back(invert(transfer, at(color, c, row, column).as<T>()));
            mean = mean + colors.back() * T(1.0 / 9);
          }
          for (const T& one : colors) squares = squares + square(T(one - mean));
          return apply(transfer, T(min(T(squares * T(1.0 / 9)), T(clip))));
        };
        store(result, c, y, x, evaluate_in_both(formula), precision);
      }
    }
  }
  return result;
}

Bounded cell_share(const Bounded& samples, int scale, double certainty, Precision precision) {
  const int h = samples.value.h / scale, w = samples.value.w / scale;
  expect_shape(samples, 1, scale * h, scale * w);
  Bounded result = exact(Planes(1, h, w));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const auto formula = [&]<typename T>(T) -> T {
        using std::exp2;
        T sum = 0;
        for (int i = 0; i < scale * scale; ++i)
          sum = sum + exp2(at(samples, 0, scale * y + i / scale, scale * x + i % scale).as<T>());
        return certainty / (certainty + sum);
      };
      store(result, 0, y, x, evaluate_in_both(formula), precision);
    }
  }
  return result;
}

}  // namespace raymeld::reference
