#include <fmt/format.h>

#include <array>
#include <limits>

#include "conform/frame_image.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::LayerKind;
using reference::Planes;
using reference::Precision;
using reference::Size;

constexpr std::array kKinds{LayerKind::kRadiance, LayerKind::kAlbedo, LayerKind::kNormal,
                            LayerKind::kVariance};
constexpr std::array kChannelKinds{ChannelKind::kRadiance, ChannelKind::kAlbedo, ChannelKind::kNormal,
                                   ChannelKind::kVariance};

struct Encoding {
  bool log;
  float clip;
  float exposure = 1;
  size_t layout = 0;
};

// Returns an image in which about half of the values are special ones. The others are radiance from around 0
// to beyond the clip, or albedo and normals in and beyond their ranges.
Planes image_of(LayerKind kind, const Size& size, const Encoding& encoding, uint64_t seed) {
  Planes image = reference::random_planes(3, size.h, size.w, reference::Fill::kSpecials, seed);
  if (kind != LayerKind::kRadiance && kind != LayerKind::kVariance) return image;
  const double most = 1.5 * encoding.clip / encoding.exposure;
  for (size_t i = 0; i < image.data.size(); ++i) {
    if (image.data[i] > -1 && image.data[i] < 1) image.data[i] = float(image.data[i] * (i % 2 ? 1 : most));
  }
  return image;
}

// Returns the device's result. Each three channels of the image have the next kind of kChannelKinds.
Planes encoded(Check& check, const Target& target, const Planes& image, const Encoding& encoding,
               const Method& method, Precision precision) {
  const FrameImage frame(target.device, image, frame_layouts()[encoding.layout]);
  std::vector<EncodedChannel> channels;
  for (int c = 0; c < image.c; ++c) channels.push_back({kChannelKinds[size_t(c / 3)], uint32_t(c)});
  LayerRun run(target, precision, method.addressed);
  const Tensor out = run.tensor("out", image.c, image.h, image.w);
  encode(run.graph(), "encode", kHrlsSlot, out, channels, encoding.log ? Transfer::kLog : Transfer::kLinear,
         encoding.clip);
  run.run(frame.frame(kHrlsSlot), encoding.exposure);
  check.that(frame.touched_outside() == 0, "wrote outside the image");
  return run.read(out);
}

void check_random(Check& check, const Target& target, const Size& size, const Encoding& encoding,
                  uint64_t seed, const Method& method, Precision precision) {
  Planes image(0, size.h, size.w);
  Bounded expected = reference::exact(image);
  for (const LayerKind kind : kKinds) {
    const Planes layer = image_of(kind, size, encoding, seed + 7 * uint64_t(image.c));
    const Bounded one = reference::encode(
        layer, kind, encoding.log ? reference::Transfer::kLog : reference::Transfer::kLinear, encoding.clip,
        precision, encoding.exposure);
    expected = concat(expected, one);
    image = concat(image, layer);
  }
  check.within(encoded(check, target, image, encoding, method, precision), expected);
}

// Every other run of 16 values is noise on a level far above it, as on an even wall. The other runs are as
// image_of() makes them.
void check_variance(Check& check, const Target& target, const Size& size, const Encoding& encoding,
                    uint64_t seed, const Method& method, Precision precision) {
  Planes image = image_of(LayerKind::kRadiance, size, encoding, seed);
  const Planes noise = reference::random_planes(3, size.h, size.w, reference::Fill::kUniform, seed + 1);
  for (size_t i = 0; i < image.data.size(); ++i)
    if (i / 16 % 2 == 0) image.data[i] = float((8 + 0.01 * noise.data[i]) / encoding.exposure);
  const FrameImage frame(target.device, image, frame_layouts()[encoding.layout]);
  LayerRun run(target, precision, method.addressed);
  const Tensor out = run.tensor("out", image.c, image.h, image.w);
  variance(run.graph(), "variance", out, encoding.log ? Transfer::kLog : Transfer::kLinear, encoding.clip);
  run.run(frame.frame(kHrlsSlot), encoding.exposure);
  check.within(
      run.read(out),
      reference::variance(image, encoding.log ? reference::Transfer::kLog : reference::Transfer::kLinear,
                          encoding.clip, precision, encoding.exposure));
}

// Checks values known by hand, whose sums are exact: a single bright pixel, the edge, and a NaN.
void check_exact_variance(Check& check, const Target& target, const Method& method, Precision precision) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const Planes row(1, 1, 5, {0, 0, 9, 0, kNaN});
  Planes expected(1, 1, 5, {0, 18, 18, 18, 0});  // 81 / 3 - 3^2
  const FrameImage frame(target.device, concat(concat(row, row), row));
  LayerRun run(target, precision, method.addressed);
  const Tensor out = run.tensor("out", 3, 1, 5);
  variance(run.graph(), "variance", out, Transfer::kLinear, 100);
  run.run(frame.frame(kHrlsSlot));
  Bounded bounded = reference::exact(concat(concat(expected, expected), expected));
  for (double& bound : bounded.bound.data) bound = 18 * (precision == Precision::kFp16 ? 1e-3 : 1e-6);
  check.within(run.read(out), bounded);
}

// Checks radiance above the clip, which depends on the exposure only through clip / exposure.
void check_above_clip(Check& check, const Target& target, const Size& size, const Encoding& encoding,
                      uint64_t seed, const Method& method, Precision precision) {
  const Planes image = image_of(LayerKind::kRadiance, size, encoding, seed);
  const FrameImage frame(target.device, image, frame_layouts()[encoding.layout]);
  LayerRun run(target, precision, method.addressed);
  const Tensor out = run.tensor("out", image.c, image.h, image.w);
  above_clip(run.graph(), "above_clip", kLrhsSlot, out, encoding.clip);
  run.run(frame.frame(kLrhsSlot), encoding.exposure);
  check.within(run.read(out), reference::above_clip(image, encoding.clip, precision, encoding.exposure));
}

// Checks values that are not finite, above the clip or out of range.
void check_sanitised(Check& check, const Target& target, const Method& method, Precision precision) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const Planes row(1, 1, 8, {kNaN, -kNaN, kInfinity, -kInfinity, 1e30, -1e30, -0.5, 0.25});
  Planes image(0, 1, 8);
  for (int c = 0; c < 9; ++c) image = concat(image, row);
  Planes expected(9, 1, 8);
  const std::array<std::array<double, 8>, 3> of_kinds{{{0, 0, 50, 0, 50, 0, 0, 0.25},       // radiance
                                                       {0, 0, 1, 0, 1, 0, 0, 0.25},         // albedo
                                                       {0, 0, 1, -1, 1, -1, -0.5, 0.25}}};  // normal
  for (int c = 0; c < 9; ++c)
    for (int x = 0; x < 8; ++x) expected.at(c, 0, x) = of_kinds[size_t(c / 3)][size_t(x)];
  const Encoding encoding{.log = false, .clip = 50};
  check.within(encoded(check, target, image, encoding, method, precision), reference::exact(expected));
}

}  // namespace

void conform_encode(Collector& collector) {
  constexpr std::array kExposures{1.0f, 0.013f, 770.0f, 0x1p-24f, 0x1p24f};
  Collector::for_each(plain_methods(), [&](const Method& method, Precision precision) {
    collector.run("encode", method, precision, "values that are not finite or out of range, 9 x 1 x 8",
                  [&](Check& check) { check_sanitised(check, collector.target(), method, precision); });
    collector.run("variance", method, precision, "one bright pixel, 3 x 1 x 5",
                  [&](Check& check) { check_exact_variance(check, collector.target(), method, precision); });
    uint64_t next = precision == Precision::kFp16 ? 3 : 0;
    for (const bool log : {false, true}) {
      for (const Size& size : collector.sizes()) {
        const Encoding encoding{.log = log,
                                .clip = log ? 1000.0f : 100.0f,
                                .exposure = kExposures[next % kExposures.size()],
                                .layout = (next + next / 5) % frame_layouts().size()};
        const uint64_t seed = ++next;
        collector.run("encode", method, precision,
                      fmt::format("{}, exposure {:g}, layout {}, 12 x {} x {}", log ? "log" : "linear",
                                  encoding.exposure, encoding.layout, size.h, size.w),
                      [&](Check& check) {
                        check_random(check, collector.target(), size, encoding, seed, method, precision);
                      });
        collector.run("variance", method, precision,
                      fmt::format("{}, exposure {:g}, layout {}, 3 x {} x {}", log ? "log" : "linear",
                                  encoding.exposure, encoding.layout, size.h, size.w),
                      [&](Check& check) {
                        check_variance(check, collector.target(), size, encoding, seed, method, precision);
                      });
        if (log) continue;
        collector.run("above_clip", method, precision,
                      fmt::format("exposure {:g}, layout {}, 3 x {} x {}", encoding.exposure, encoding.layout,
                                  size.h, size.w),
                      [&](Check& check) {
                        check_above_clip(check, collector.target(), size, encoding, seed, method, precision);
                      });
      }
    }
  });
}

}  // namespace raymeld::conform
