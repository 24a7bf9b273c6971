#include <fmt/format.h>

#include <cfloat>
#include <cmath>
#include <limits>

#include "conform/conv2d_trials.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;

// Runs 1x1 convolutions of one channel with one kernel.
struct Pointwise {
  Check& check;
  const Target& target;
  const Method& method;
  Precision precision;

  // Returns the device's result for a row of pixels.
  Planes row(const std::vector<float>& in, float weight, float bias, bool relu, Status& status) const {
    LayerRun run(target, precision, method.addressed);
    const Tensor x = run.input("in", reference::planes(1, 1, int(in.size()), in));
    const Tensor y = run.tensor("out", 1, 1, int(in.size()));
    conv2d(run.graph(), "conv", x, y,
           run.weights({.out = 1, .in = 1, .kernel = 1, .weight = {weight}, .bias = {bias}}),
           {.kernel = 1, .relu = relu, .how = method.kernel});
    run.run();
    status = run.status();
    return run.read(y);
  }

  // Checks that in * weight + bias is `out`, and that the device counts `saturated` values beyond 16 bits.
  void gives(const std::vector<float>& in, float weight, float bias, const std::vector<float>& out,
             uint32_t saturated, const std::string& what) const {
    Status status;
    const Planes result = row(in, weight, bias, false, status);
    check.within(result, exact(reference::planes(1, 1, int(out.size()), out)), what);
    check.that(status.saturated == saturated, fmt::format("{}: counted {} values as saturated, expected {}",
                                                          what, status.saturated, saturated));
  }
};

void check_large(const Pointwise& run) {
  if (run.precision == Precision::kFp32) {
    const std::vector<float> in{-0.0f,   FLT_MIN,  65519,    65520,     1e8f, 1e30f,
                                FLT_MAX, -FLT_MAX, INFINITY, -INFINITY, NAN};
    return run.gives(in, 1, 0, in, 0, "times 1");
  }
  run.gives({65504, -65504, 60000}, 1, 0, {65504, -65504, 60000}, 0, "times 1");
  run.gives({65504, -65504, 40000, 2}, 2, 0, {65504, -65504, 65504, 4}, 3, "times 2");
  run.gives({65504, 65504 - 32}, 1, 15, {65504, 65472}, 1, "plus 15");  // 65519, 65487
  run.gives({INFINITY, -INFINITY}, 1, 0, {65504, -65504}, 2, "infinities");
  run.gives({1, 2, 3}, 1, 70000, {65504, 65504, 65504}, 3, "plus 70000, counted inside the image only");
}

// Subnormals of fp32 may be flushed to 0. Subnormals of halves are normal numbers in fp32.
void check_denormals(const Pointwise& run) {
  Status status;
  const bool half = run.precision == Precision::kFp16;
  const std::vector<float> in = half ? std::vector<float>{0x1p-24f, -0x1p-15f, 0x1.8p-16f}
                                     : std::vector<float>{1e-40f, -1e-40f, FLT_TRUE_MIN};
  Bounded expected = exact(reference::planes(1, 1, 3, in));
  if (!half) expected.bound.data.assign(3, reference::kFlush);
  run.check.within(run.row(in, 1, 0, false, status), expected);
}

// If ReLU dropped NaN or -infinity, it would hide an overflow from decode's count of values that are not
// finite, or from the count of saturated values.
void check_relu(const Pointwise& run) {
  Status status;
  const bool half = run.precision == Precision::kFp16;
  const Planes out = run.row({-1, -0.0f, 3, NAN, -NAN, -INFINITY}, 1, 0, true, status);
  run.check.within(out, exact(Planes(1, 1, 6, {0, 0, 3, NAN, NAN, half ? -65504 : -INFINITY})));
  run.check.that(status.saturated == half,
                 fmt::format("counted {} values as saturated, expected {}", status.saturated, int(half)));
}

struct Poison {
  float value;
  int y, x;
};

// Returns the first and the last pixel in one direction whose result a changed pixel may change: its
// neighbours or, in tiles of several pixels, all pixels of the tiles that hold these.
std::pair<int, int> changed_range(int pixel, int size, int tile) {
  const int first = std::max(pixel - 1, 0) / tile * tile, last = (pixel + 1) / tile * tile + tile - 1;
  return {first, std::min(last, size - 1)};
}

// Checks that the poisoned pixel changes results within its range and no others, and that no result hides a
// NaN or an infinity that it reads.
void check_spread(Check& check, const Poison& poison, const Planes& before, Planes after,
                  const Method& method) {
  const std::string what = fmt::format("{:g} at y {}, x {}", poison.value, poison.y, poison.x);
  const auto [top, bottom] = changed_range(poison.y, after.h, method.tile().down);
  const auto [left, right] = changed_range(poison.x, after.w, method.tile().across);
  size_t changed = 0, hidden = 0;
  for (int c = 0; c < after.c; ++c) {
    for (int v = top; v <= bottom; ++v) {
      for (int u = left; u <= right; ++u) {
        const double value = after.at(c, v, u);
        const bool reads = std::abs(v - poison.y) <= 1 && std::abs(u - poison.x) <= 1;
        hidden += reads && !std::isfinite(poison.value) && std::isfinite(value) && std::abs(value) < 65504;
        changed += value != before.at(c, v, u);
        after.at(c, v, u) = before.at(c, v, u);
      }
    }
  }
  check.within(after, exact(before), what + ", results out of its reach");
  check.that(changed > 0, what + ": no result changed");
  check.that(hidden == 0, fmt::format("{}: {} results that read it are finite", what, hidden));
}

// Checks that padding and the tails of tiles read nothing of a poisoned pixel, wherever it lies. Finite
// values must keep their bounds where they are read, but only up to 1e30: beyond, transforms overflow where
// direct sums do not.
void check_poison(Check& check, const Target& target, const Method& method, Precision precision) {
  const reference::Conv conv =
      round_to(reference::random_conv(9, 5, 3, reference::Fill::kUniform, 4), precision);
  const Planes clean = round_to(reference::random_planes(5, 11, 35, reference::Fill::kUniform, 3), precision);
  const std::vector<float> values = precision == Precision::kFp16
                                        ? std::vector<float>{6e4f, INFINITY, NAN}
                                        : std::vector<float>{1e8f, 1e30f, FLT_MAX, INFINITY, NAN};
  LayerRun run(target, precision, method.addressed);
  const auto add = [&](const Planes& image) {
    const Tensor in = run.input("in", image), out = run.tensor("out", conv.out, image.h, image.w);
    conv2d(run.graph(), "conv", in, out, run.weights(conv),
           {.kernel = 3, .relu = true, .how = method.kernel});
    return out;
  };
  struct Poisoned {
    Poison poison;
    Planes image;
    Tensor out;
  };
  const Tensor before = add(clean);
  std::vector<Poisoned> poisoned;
  for (const auto& [y, x] : {std::pair(0, 0), {10, 34}, {4, 32}, {3, 0}}) {
    for (const float value : values) {
      Planes image = round_to(clean, precision);
      image.at(2, y, x) = round_to(value, precision);
      poisoned.push_back({.poison = {.value = value, .y = y, .x = x}, .image = image, .out = add(image)});
    }
  }
  run.run();
  for (const auto& [poison, image, out] : poisoned) {
    const Planes after = run.read(out);
    check_spread(check, poison, run.read(before), after, method);
    if (!(poison.value <= 1e30f)) continue;
    check.within(
        after,
        reference::conv2d(exact(image), conv, true, precision, {}, method.tile(), method.units(precision)),
        fmt::format("{:g} at y {}, x {}", poison.value, poison.y, poison.x));
  }
}

}  // namespace

void run_specials(Collector& collector) {
  const auto run_each = [&](uint32_t kernel, const char* what,
                            const std::function<void(Check&, const Method&, Precision)>& body) {
    const std::vector<Method> methods =
        conv2d_methods(collector.device().info(), kernel, collector.options().extent);
    Collector::for_each(methods, [&](const Method& method, Precision precision) {
      collector.run(kernel == 1 ? "conv2d 1x1" : "conv2d 3x3", method, precision, what,
                    [&](Check& check) { body(check, method, precision); });
    });
  };
  const Target& target = collector.target();
  run_each(1, "large values, infinities and NaN",
           [&](Check& check, const Method& method, Precision precision) {
             check_large({check, target, method, precision});
           });
  run_each(1, "denormals", [&](Check& check, const Method& method, Precision precision) {
    check_denormals({check, target, method, precision});
  });
  run_each(1, "ReLU of NaN, -infinity and -0", [&](Check& check, const Method& method, Precision precision) {
    check_relu({check, target, method, precision});
  });
  run_each(3, "one poisoned pixel, 5 -> 9 channels, 11 x 35",
           [&](Check& check, const Method& method, Precision precision) {
             check_poison(check, target, method, precision);
           });
}

}  // namespace raymeld::conform
