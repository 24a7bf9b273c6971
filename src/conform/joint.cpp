#include "conform/image_trial.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;
using reference::slice;

void check_irradiance(Check& check, const ImageTrial& c) {
  const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls();
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor lrhs = run.input("lrhs", low), high = run.input("hrls", hrls), out = lrhs.slice(3, 3);
  irradiance(run.graph(), "irradiance", lrhs.slice(0, 3), high.slice(3, 3), high.slice(6, 3), out,
             c.options());
  run.run();
  const Bounded all = exact(hrls), color = slice(exact(low), 0, 3);
  check.within(run.read(out), reference::irradiance(color, slice(all, 3, 3), slice(all, 6, 3),
                                                    c.expected_transfer(), c.scale, c.phase, c.precision));
  check.same_bits(run.read(lrhs.slice(0, 3)), color.value, "channels before the output");
}

void check_demodulate(Check& check, const ImageTrial& c) {
  const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls();
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor lrhs = run.input("lrhs", low), high = run.input("hrls", hrls);
  const Tensor out = run.tensor("out", 5, c.full().h, c.full().w);
  demodulate(run.graph(), "demodulate", high.slice(0, 3), high.slice(3, 3), lrhs, out, c.options());
  run.run();
  const Bounded all = exact(hrls);
  check.within(run.read(out),
               reference::demodulate(slice(all, 0, 3), slice(all, 3, 3), exact(low), ImageTrial::kCertainty,
                                     c.expected_transfer(), c.scale, c.phase, c.precision));
}

// Brightness varies within the width of the filter, or about as much as it can.
void check_filter(Check& check, const ImageTrial& c) {
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
    const Planes brightness = c.image(
        1, c.full(), 5, [&](double u) { return reference::apply(c.expected_transfer(), 1 + range * u); });
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

void check_remodulate(Check& check, const ImageTrial& c) {
  const double brightest = std::log1p(0.2 * c.clip() / 0.4) / 0.2;
  const Planes hrls = c.hrls(), x = c.image(3, c.full(), 4, [&](double u) { return brightest * u; });
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor in = run.input("in", x), high = run.input("hrls", hrls);
  const Tensor out = run.tensor("out", 9, c.full().h, c.full().w).slice(3, 3);
  remodulate(run.graph(), "remodulate", in, high.slice(3, 3), out, c.options().transfer);
  run.run();
  check.within(run.read(out),
               reference::remodulate(exact(x), slice(exact(hrls), 3, 3), c.expected_transfer(), c.precision));
  const Planes rest = c.radiance(3, c.full(), 5);
  const Planes sum = run_layer(c, {x, concat(hrls, rest)}, c.full(),
                               [&](Graph& graph, const auto& tensors, const Tensor& to) {
                                 remodulate(graph, "remodulate", tensors[0], tensors[1].slice(3, 3), to,
                                            c.options().transfer, tensors[1].slice(9, 3));
                               });
  const reference::Bounded added = exact(rest);
  check.within(
      sum,
      reference::remodulate(exact(x), slice(exact(hrls), 3, 3), c.expected_transfer(), c.precision, &added),
      "with the rest");
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
void check_mix(Check& check, const ImageTrial& c) {
  const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls(), filtered = c.radiance(9, c.full(), 4);
  const Planes rec = c.image(8, c.full(), 5, [](double u) { return u == 0 ? -80 : u == 1 ? 80 : 8 * u - 4; });
  LayerRun run(c.target, c.precision, c.method.addressed);
  const Tensor in = run.input("rec", rec), lrhs = run.input("lrhs", low), high = run.input("hrls", hrls);
  const Tensor candidates = run.input("candidates", filtered);
  const Tensor out = run.tensor("out", 3, c.full().h, c.full().w);
  mix(run.graph(), "mix", in, lrhs, high.slice(3, 3), candidates, out, c.options());
  run.run();
  check.within(run.read(out),
               reference::mix(exact(rec), exact(low), slice(exact(hrls), 3, 3), exact(filtered),
                              c.expected_transfer(), c.scale, c.phase, c.precision));
}

constexpr ImageLayer kJointLayers[] = {{.name = "irradiance", .check = check_irradiance},
                                       {.name = "demodulate", .check = check_demodulate},
                                       {.name = "joint_filter", .check = check_filter},
                                       {.name = "remodulate", .check = check_remodulate},
                                       {.name = "mix", .check = check_mix}};

}  // namespace

void conform_joint(Collector& collector) {
  std::vector<Method> methods(plain_methods().begin(), plain_methods().end());
  const uint32_t lanes = collector.device().info().vector_lanes;
  if (lanes > 0) methods.push_back({.name = "by vectors", .kernel = {.vector = lanes}});
  Collector::for_each(methods, [&](const Method& method, Precision precision) {
    for (const ImageLayer& layer : kJointLayers) {
      // Only joint_filter() in 32 bits reads vectors.
      if (method.kernel.vector == 0 || (layer.check == check_filter && precision == Precision::kFp32))
        try_layer(collector, layer, method, precision);
    }
    if (precision != Precision::kFp16 || method.kernel.vector > 0) return;
    collector.run("remodulate", method, precision, "values beyond 16 bits, 1 x 1",
                  [&](Check& check) { check_saturation(check, collector.target(), method); });
  });
}

}  // namespace raymeld::conform
