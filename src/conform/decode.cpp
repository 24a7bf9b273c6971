#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "conform/frame_image.h"
#include "conform/suites.h"
#include "reference/transfer.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;
using reference::Size;

struct Decoding {
  bool log = false, bilinear = false;
  int scale = 2;
  float phase = 0;
  float exposure = 1;
  size_t layout = 0;
  float clip = 0;  // 0: there is no radiance above the clip
};

struct Decoded {
  Planes image;
  Status status;
};

// Returns the device's result; `base` and `above_clip` may be null.
Decoded decoded(Check& check, const Target& target, const Planes& rec, const Planes* base,
                const Decoding& decoding, const Method& method, Precision precision,
                const Planes* above_clip = nullptr) {
  const Shape shape{uint32_t(rec.h), uint32_t(rec.w), uint32_t(rec.c)};
  const FrameImage frame(target.device, shape, frame_layouts()[decoding.layout]);
  LayerRun run(target, precision, method.addressed);
  const Tensor in = run.input("rec", rec);
  Tensor lrhs, above;
  if (base) lrhs = run.input("lrhs", *base);
  if (above_clip) above = run.input("above_clip", *above_clip);
  decode(run.graph(), "decode", in,
         {.transfer = decoding.log ? Transfer::kLog : Transfer::kLinear,
          .base = base ? &lrhs : nullptr,
          .scale = uint32_t(decoding.scale),
          .phase = decoding.phase,
          .above_clip = above_clip ? &above : nullptr,
          .clip = decoding.clip});
  run.run(frame.frame(kFusedSlot), decoding.exposure);
  check.that(frame.touched_outside() == 0, "wrote outside the image");
  return {frame.read(), run.status()};
}

void check_random(Check& check, const Target& target, const Size& size, const Decoding& decoding,
                  uint64_t seed, const Method& method, Precision precision) {
  const int s = decoding.scale;
  Planes rec = reference::random_planes(3, size.h * s, size.w * s, reference::Fill::kUniform, seed);
  for (double& v : rec.data) v *= decoding.log ? 3 : 100;
  rec = round_to(rec, precision);
  const Planes base =
      round_to(reference::random_planes(3, size.h, size.w, reference::Fill::kUniform, seed + 1), precision);
  const Bounded upsampled = reference::bilinear(exact(base), s, decoding.phase);
  // Radiance above the clip is of all sizes, and 0 at every third sample.
  Planes above_clip = reference::random_planes(3, size.h, size.w, reference::Fill::kUniform, seed + 2);
  for (size_t i = 0; i < above_clip.data.size(); ++i)
    above_clip.data[i] = i % 3 ? 1e4 * std::pow(above_clip.data[i], 4) : 0;
  above_clip = round_to(above_clip, precision);
  const Bounded upsampled_above = reference::self_weighted(exact(above_clip), s, decoding.phase);
  const bool has_above_clip = decoding.clip > 0;
  const Decoded result = decoded(check, target, rec, decoding.bilinear ? &base : nullptr, decoding, method,
                                 precision, has_above_clip ? &above_clip : nullptr);
  const Bounded expected = reference::decode(
      exact(rec), decoding.bilinear ? &upsampled : nullptr,
      decoding.log ? reference::Transfer::kLog : reference::Transfer::kLinear, Precision::kFp32,
      decoding.exposure, has_above_clip ? &upsampled_above : nullptr, decoding.clip);
  check.within(result.image, expected);
  check.that(result.status.not_finite == 0, "counted values that are not finite");
}

// A ramp of samples at X = s i + phase is reproduced between the samples and held beyond them.
void check_ramp(Check& check, const Target& target, const Method& method, Precision precision) {
  for (const float phase : {0.0f, 1.5f}) {
    const Planes base(1, 1, 3, {4 * 0 + phase, 4 * 1 + phase, 4 * 2 + phase});
    Planes expected(1, 4, 12);
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 12; ++x) expected.at(0, y, x) = std::clamp(double(x), double(phase), 8.0 + phase);
    const Decoding decoding{.bilinear = true, .scale = 4, .phase = phase};
    const Planes result = decoded(check, target, Planes(1, 4, 12), &base, decoding, method, precision).image;
    check.within(result, exact(expected), fmt::format("phase {:g}", phase));
  }
}

void check_not_finite(Check& check, const Target& target, const Method& method, Precision precision) {
  const Planes rec(1, 1, 8, {NAN, -NAN, INFINITY, -INFINITY, 0, 1, -1, 2});
  for (const bool log : {false, true}) {
    const Decoded result = decoded(check, target, rec, nullptr, {.log = log}, method, precision);
    check.that(result.status.not_finite == 4,
               fmt::format("counted {} of 4 values that are not finite", result.status.not_finite));
    Planes finite = rec;
    for (int x = 0; x < 4; ++x) finite.at(0, 0, x) = 0;
    const auto transfer = log ? reference::Transfer::kLog : reference::Transfer::kLinear;
    check.within(result.image, reference::decode(exact(finite), nullptr, transfer, Precision::kFp32),
                 log ? "log" : "linear");
  }
}

// Checks that the output is clamped after the exposure is undone, so that none of the range is lost. The log
// transfer keeps a value far below 1 / exposure only as precisely as 1 + 8 x does, but at 0.01 / exposure the
// bound must still be small.
void check_range(Check& check, const Target& target, const Method& method) {
  for (const float exposure : {0x1p-24f, 0x1p-7f, 1.0f, 0x1p7f, 0x1p24f}) {
    const std::array radiance{0.25, 60000.0, 65504.0, 1e6, std::min(0.01 / exposure, 60000.0)};
    for (const bool log : {false, true}) {
      const auto transfer = log ? reference::Transfer::kLog : reference::Transfer::kLinear;
      Planes rec(1, 1, int(radiance.size()));
      for (size_t i = 0; i < radiance.size(); ++i)
        rec.data[i] = float(reference::apply(transfer, radiance[i] * exposure));
      const std::string what = fmt::format("{}, exposure {:g}", log ? "log" : "linear", exposure);
      const Bounded expected = reference::decode(exact(rec), nullptr, transfer, Precision::kFp32, exposure);
      for (size_t i = 0; i < radiance.size(); ++i) {
        const bool precise = !log || radiance[i] * exposure >= 0.0099;
        check.that(!precise || expected.bound.data[i] <= 2e-5 * radiance[i],
                   fmt::format("{}: the bound of {} is {}", what, radiance[i], expected.bound.data[i]));
        check.that(!precise || std::abs(expected.value.data[i] - std::min(radiance[i], 65504.0)) <=
                                   2e-5 * radiance[i],
                   fmt::format("{}: the reference has {} for {}", what, expected.value.data[i], radiance[i]));
      }
      const Decoding decoding{.log = log, .exposure = exposure};
      check.within(decoded(check, target, rec, nullptr, decoding, method, Precision::kFp32).image, expected,
                   what);
    }
  }
}

void check_clamped(Check& check, const Target& target, const Method& method) {
  const Planes rec(1, 1, 5, {1e8, 3e38, -1e8, 65504, 65505});
  check.within(decoded(check, target, rec, nullptr, {}, method, Precision::kFp32).image,
               exact(Planes(1, 1, 5, {65504, 65504, 0, 65504, 65504})), "linear");
  const Planes logs(1, 1, 4, {4.4, 1e8, 3e38, -1e8});
  check.within(decoded(check, target, logs, nullptr, {.log = true}, method, Precision::kFp32).image,
               exact(Planes(1, 1, 4, {65504, 65504, 65504, 0})), "log");
}

void run_special(Collector& collector, const Method& method, Precision precision) {
  const Target& target = collector.target();
  collector.run("decode", method, precision, "bilinear base of a ramp, 1 x 4 x 12",
                [&](Check& check) { check_ramp(check, target, method, precision); });
  collector.run("decode", method, precision, "values that are not finite, 1 x 1 x 8",
                [&](Check& check) { check_not_finite(check, target, method, precision); });
  if (precision != Precision::kFp32) return;  // fp16 does not hold the range
  collector.run("decode", method, precision, "the range of halves at exposures from 2^-24 to 2^24, 1 x 1 x 5",
                [&](Check& check) { check_range(check, target, method); });
  collector.run("decode", method, precision, "values beyond the range of halves, 1 x 1 x 5",
                [&](Check& check) { check_clamped(check, target, method); });
}

// Returns all combinations of transfer, base, scale and phase.
std::vector<Decoding> decodings() {
  std::vector<Decoding> all;
  for (const int scale : {2, 4, 8}) {
    for (const bool log : {false, true}) {
      all.push_back({.log = log, .scale = scale});
      for (const float phase : {0.0f, (float(scale) - 1) / 2})
        all.push_back({.log = log, .bilinear = true, .scale = scale, .phase = phase});
    }
  }
  for (size_t i = 0; i < all.size(); ++i) {
    all[i].exposure = std::array{1.0f, 0.013f, 770.0f, 0.3f}[i % 4];
    all[i].layout = i % frame_layouts().size();
    if (i % 2) all[i].clip = 200;
  }
  return all;
}

}  // namespace

void conform_decode(Collector& collector) {
  const std::vector<Decoding> all = decodings();
  const auto sizes = collector.sizes();
  Collector::for_each(plain_methods(), [&](const Method& method, Precision precision) {
    run_special(collector, method, precision);
    for (size_t i = 0; i < std::max(all.size(), sizes.size()); ++i) {
      const Decoding& decoding = all[i % all.size()];
      const Size& size = sizes[i % sizes.size()];
      collector.run(
          "decode", method, precision,
          fmt::format("x{}, {}, {}{}, exposure {:g}, layout {}, 3 x {} x {}", decoding.scale,
                      decoding.log ? "log" : "linear",
                      decoding.bilinear ? fmt::format("base at phase {:g}", decoding.phase) : "no base",
                      decoding.clip > 0 ? ", radiance above the clip" : "", decoding.exposure,
                      decoding.layout, size.h * decoding.scale, size.w * decoding.scale),
          [&](Check& check) {
            check_random(check, collector.target(), size, decoding, i, method, precision);
          });
    }
  });
}

}  // namespace raymeld::conform
