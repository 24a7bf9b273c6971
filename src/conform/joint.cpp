#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "conform/suites.h"
#include "reference/transfer.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;
using reference::Size;
using reference::slice;

// Describes one run of a layer. The images hold values as the device would store them.
struct JointTrial {
  static constexpr float kCertainty = 10;

  const Target& target;
  const Method& method;
  Precision precision;
  bool log;
  int scale;
  float phase;
  Size size;  // the size of LRHS
  uint64_t seed;

  JointOptions options() const {
    return {.transfer = log ? Transfer::kLog : Transfer::kLinear,
            .scale = uint32_t(scale),
            .phase = phase,
            .lrhs_certainty = kCertainty};
  }
  reference::Transfer transfer() const {
    return log ? reference::Transfer::kLog : reference::Transfer::kLinear;
  }
  double clip() const { return log ? 1000 : 100; }
  Size full() const { return {scale * size.h, scale * size.w}; }
  std::string shape() const {
    return fmt::format("x{}, {}, phase {:g}, {} x {} from {} x {}", scale, log ? "log" : "linear", phase,
                       full().h, full().w, size.h, size.w);
  }

  // Returns an image of value(u) with random u in [0, 1], both ends among them.
  template <typename Value>
  Planes image(int channels, const Size& of, uint64_t salt, const Value& value) const {
    Planes image =
        reference::random_planes(channels, of.h, of.w, reference::Fill::kUniform, 100 * seed + salt);
    for (double& v : image.data) v = value(std::clamp(0.55 * v + 0.5, 0.0, 1.0));
    return round_to(image, precision);
  }
  // Returns encoded radiance from 0 to the clip.
  Planes radiance(int channels, const Size& of, uint64_t salt) const {
    return image(channels, of, salt,
                 [&](double u) { return reference::apply(transfer(), clip() * std::pow(u, 4)); });
  }
  // Returns color, albedo and normal as one tensor.
  Planes hrls() const {
    const Planes albedo = image(3, full(), 2, [](double u) { return u; });
    const Planes normal = image(3, full(), 3, [](double u) { return 2 * u - 1; });
    return concat(concat(radiance(3, full(), 1), albedo), normal);
  }
};

void check_irradiance(Check& check, const JointTrial& c) {
  const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls();
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor lrhs = run.input("lrhs", low), high = run.input("hrls", hrls), out = lrhs.slice(3, 3);
  irradiance(run.graph(), "irradiance", lrhs.slice(0, 3), high.slice(3, 3), high.slice(6, 3), out,
             c.options());
  run.run();
  const Bounded all = exact(hrls), color = slice(exact(low), 0, 3);
  check.within(run.read(out), reference::irradiance(color, slice(all, 3, 3), slice(all, 6, 3), c.transfer(),
                                                    c.scale, c.phase, c.precision));
  check.same_bits(run.read(lrhs.slice(0, 3)), color.value, "channels before the output");
}

void check_demodulate(Check& check, const JointTrial& c) {
  const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls();
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor lrhs = run.input("lrhs", low), high = run.input("hrls", hrls);
  const Tensor out = run.tensor("out", 5, c.full().h, c.full().w);
  demodulate(run.graph(), "demodulate", high.slice(0, 3), high.slice(3, 3), lrhs, out, c.options());
  run.run();
  const Bounded all = exact(hrls);
  check.within(run.read(out),
               reference::demodulate(slice(all, 0, 3), slice(all, 3, 3), exact(low), JointTrial::kCertainty,
                                     c.transfer(), c.scale, c.phase, c.precision));
}

// Brightness varies within the width of the filter, or about as much as it can.
void check_filter(Check& check, const JointTrial& c) {
  const Planes hrls = c.hrls();
  const Planes certainty = c.image(1, c.full(), 6, [](double u) { return 1 + 60 * u; });
  const Planes x = concat(c.image(3, c.full(), 4, [](double u) { return 30 * u; }), certainty);
  const int step = 1 << c.seed % 5;
  const bool learned = c.seed % 2 == 1;  // the widths are not the filter's own
  const GuideFactors factors = learned ? GuideFactors{3, 0.5f, 1.5f} : GuideFactors{};
  LayerRun run(c.target, c.precision, c.method.addressed);
  run.graph().read_vectors(c.method.kernel.vector);
  const Tensor in = run.input("in", x), high = run.input("hrls", hrls);
  struct Filtered {
    Planes brightness;
    Tensor out, lane_by_lane;
  };
  std::vector<Filtered> outputs;  // one for each range of brightness
  for (const double range : {0.1, c.clip()}) {
    const Planes brightness =
        c.image(1, c.full(), 5, [&](double u) { return reference::apply(c.transfer(), 1 + range * u); });
    const Tensor guide = run.input("brightness", brightness);
    const Tensor out = run.tensor("out", 4, c.full().h, c.full().w);
    const auto filter = [&](const Tensor& target) {
      joint_filter(run.graph(), "filter", in, high.slice(3, 3), high.slice(6, 3), guide, target,
                   uint32_t(step), factors);
    };
    filter(out);
    outputs.push_back({brightness, out, out});
    if (c.method.kernel.vector == 0) continue;
    outputs.back().lane_by_lane = run.tensor("lane by lane", 4, c.full().h, c.full().w);
    run.graph().read_vectors(0);
    filter(outputs.back().lane_by_lane);
    run.graph().read_vectors(c.method.kernel.vector);
  }
  run.run();
  for (const auto& [brightness, out, lane_by_lane] : outputs) {
    check.same_bits(run.read(out), run.read(lane_by_lane), "by vectors and lane by lane");
    check.within(run.read(out),
                 reference::joint_filter(exact(x), slice(exact(hrls), 3, 3), slice(exact(hrls), 6, 3),
                                         exact(brightness), step, c.precision,
                                         {factors.albedo, factors.normal, factors.brightness}),
                 fmt::format("step {}, {} brightness", step, &out == &outputs[0].out ? "even" : "varied"));
  }
}

void check_remodulate(Check& check, const JointTrial& c) {
  const double brightest = std::log1p(0.2 * c.clip() / 0.4) / 0.2;
  const Planes hrls = c.hrls(), x = c.image(3, c.full(), 4, [&](double u) { return brightest * u; });
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor in = run.input("in", x), high = run.input("hrls", hrls);
  const Tensor out = run.tensor("out", 9, c.full().h, c.full().w).slice(3, 3);
  remodulate(run.graph(), "remodulate", in, high.slice(3, 3), out, c.options().transfer);
  run.run();
  check.within(run.read(out),
               reference::remodulate(exact(x), slice(exact(hrls), 3, 3), c.transfer(), c.precision));
}

void check_saturation(Check& check, const Target& target, const Method& method) {
  LayerRun run(target, Precision::kFp16, method.addressed);
  const Tensor in = run.input("in", Planes(3, 1, 1, {1, 52, 52}));
  const Tensor albedo = run.input("albedo", Planes(3, 1, 1, {1, 1, 1})), out = run.tensor("out", 3, 1, 1);
  remodulate(run.graph(), "remodulate", in, albedo, out, Transfer::kLinear);
  run.run();
  check.within(run.read(out.slice(1, 2)), exact(Planes(2, 1, 1, {65504, 65504})));
  check.that(run.status().saturated == 2,
             fmt::format("counted {} of 2 values as saturated", run.status().saturated));
}

// Most logits are from -4 to 4, and some are -80 or 80.
void check_mix(Check& check, const JointTrial& c) {
  const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls(), filtered = c.radiance(9, c.full(), 4);
  const Planes rec = c.image(8, c.full(), 5, [](double u) { return u == 0 ? -80 : u == 1 ? 80 : 8 * u - 4; });
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor in = run.input("rec", rec), lrhs = run.input("lrhs", low), high = run.input("hrls", hrls);
  const Tensor candidates = run.input("candidates", filtered);
  const Tensor out = run.tensor("out", 3, c.full().h, c.full().w);
  mix(run.graph(), "mix", in, lrhs, high.slice(3, 3), candidates, out, c.options());
  run.run();
  check.within(run.read(out), reference::mix(exact(rec), exact(low), slice(exact(hrls), 3, 3),
                                             exact(filtered), c.transfer(), c.scale, c.phase, c.precision));
}

struct Layer {
  const char* name;
  void (*check)(Check&, const JointTrial&);
};

constexpr Layer kLayers[] = {{.name = "irradiance", .check = check_irradiance},
                             {.name = "demodulate", .check = check_demodulate},
                             {.name = "joint_filter", .check = check_filter},
                             {.name = "remodulate", .check = check_remodulate},
                             {.name = "mix", .check = check_mix}};

}  // namespace

void conform_joint(Collector& collector) {
  constexpr size_t kCombinations = 2 * 3 * 2;  // transfers, scales and phases
  const auto sizes = collector.sizes();
  std::vector<Method> methods(plain_methods().begin(), plain_methods().end());
  const uint32_t lanes = collector.device().info().vector_lanes;
  if (lanes > 0) methods.push_back({.name = "by vectors", .kernel = {.vector = lanes}});
  Collector::for_each(methods, [&](const Method& method, Precision precision) {
    for (const Layer& layer : kLayers) {
      // Only joint_filter() in 32 bits reads vectors.
      if (method.kernel.vector > 0 && (layer.check != check_filter || precision == Precision::kFp16))
        continue;
      for (size_t i = 0; i < std::max(kCombinations, sizes.size()); ++i) {
        const int scale = 2 << i % 3;
        const JointTrial trial{.target = collector.target(),
                               .method = method,
                               .precision = precision,
                               .log = i / 3 % 2 == 1,
                               .scale = scale,
                               .phase = i / 6 % 2 == 1 ? (float(scale) - 1) / 2 : 0,
                               .size = sizes[i % sizes.size()],
                               .seed = i + 1};
        collector.run(layer.name, method, precision, trial.shape(),
                      [&](Check& check) { layer.check(check, trial); });
      }
    }
    if (precision != Precision::kFp16 || method.kernel.vector > 0) return;
    collector.run("remodulate", method, precision, "values beyond 16 bits, 1 x 1",
                  [&](Check& check) { check_saturation(check, collector.target(), method); });
  });
}

}  // namespace raymeld::conform
