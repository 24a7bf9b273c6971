#include "conform/image_trial.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::exact;
using reference::Planes;
using reference::Precision;

int channels_of(const ImageTrial& c) { return 1 + int(c.seed % 5); }

Planes features(const ImageTrial& c, uint64_t salt) {
  return c.image(channels_of(c), c.size, salt, [](double u) { return 20 * u - 8; });
}

void check_channel_means(Check& check, const ImageTrial& c) {
  const Planes in = features(c, 1);
  const Planes out = run_layer(
      c, {in}, {1, 1},
      [](Graph& graph, const auto& tensors, const Tensor& to) {
        channel_means(graph, "channel_means", tensors[0], to);
      },
      channels_of(c));
  check.within(out, reference::channel_means(exact(in), c.precision));
}

// Some logits are where exp() would overflow.
void check_attend(Check& check, const ImageTrial& c) {
  const Planes in = features(c, 1), residual = features(c, 2);
  const Planes logits = c.image(channels_of(c), {1, 1}, 3, [](double u) {
    return u < 0.1 ? -300 : u > 0.9 ? 300 : 12 * u - 6;
  });
  const Planes out = run_layer(
      c, {in, logits, residual}, c.size,
      [](Graph& graph, const auto& tensors, const Tensor& to) {
        attend(graph, "attend", tensors[0], tensors[1], tensors[2], to);
      },
      channels_of(c));
  check.within(out, reference::attend(exact(in), exact(logits), exact(residual), c.precision));
}

constexpr ImageLayer kAttentionLayers[] = {{.name = "channel_means", .check = check_channel_means},
                                           {.name = "attend", .check = check_attend}};

void check_gradients(Check& check, const ImageTrial& c) {
  const Planes in = features(c, 1);
  const Planes out = run_layer(
      c, {in}, c.size,
      [](Graph& graph, const auto& tensors, const Tensor& to) {
        gradients(graph, "gradients", tensors[0], to);
      },
      2 * channels_of(c));
  check.within(out, reference::gradients(exact(in), c.precision));
}

// In about half of the pixels the part is larger than the whole.
void check_remainder(Check& check, const ImageTrial& c) {
  const Planes whole = c.radiance(3, c.size, 1), part = c.radiance(3, c.size, 2);
  const Planes out =
      run_layer(c, {whole, part}, c.size, [&](Graph& graph, const auto& tensors, const Tensor& to) {
        remainder(graph, "remainder", tensors[0], tensors[1], to, c.transfer());
      });
  check.within(out, reference::remainder(exact(whole), exact(part), c.expected_transfer(), c.precision));
}

void check_remodulate(Check& check, const ImageTrial& c) {
  const double brightest = std::log1p(0.2 * c.clip() / 0.4) / 0.2;
  const Planes in = c.image(3, c.size, 1, [&](double u) { return brightest * u; });
  const Planes albedo = c.image(3, c.size, 2, [](double u) { return u; }), rest = c.radiance(3, c.size, 3);
  const Planes out =
      run_layer(c, {in, albedo, rest}, c.size, [&](Graph& graph, const auto& tensors, const Tensor& to) {
        remodulate(graph, "remodulate", tensors[0], tensors[1], tensors[2], to, c.transfer());
      });
  check.within(
      out, reference::remodulate(exact(in), exact(albedo), exact(rest), c.expected_transfer(), c.precision));
}

void check_saturation(Check& check, const Target& target, const Method& method) {
  LayerRun run(target, Precision::kFp16, method.addressed);
  const Tensor in = run.input("in", Planes(3, 1, 1, {1, 52, 52}));
  const Tensor albedo = run.input("albedo", Planes(3, 1, 1, {1, 1, 1})), out = run.tensor("out", 3, 1, 1);
  const Tensor rest = run.input("rest", Planes(3, 1, 1));
  remodulate(run.graph(), "remodulate", in, albedo, rest, out, raymeld::Transfer::kLinear);
  run.run();
  check.within(run.read(out.slice(1, 2)), exact(Planes(2, 1, 1, {65504, 65504})));
  check.that(run.status().saturated == 2,
             fmt::format("counted {} of 2 values as saturated", run.status().saturated));
}

constexpr ImageLayer kKpcnLayers[] = {{.name = "gradients", .check = check_gradients},
                                      {.name = "remainder", .check = check_remainder},
                                      {.name = "remodulate", .check = check_remodulate}};

}  // namespace

void conform_attention(Collector& collector) { try_layers(collector, kAttentionLayers); }

void conform_kpcn(Collector& collector) {
  try_layers(collector, kKpcnLayers);
  Collector::for_each(plain_methods(), [&](const Method& method, Precision precision) {
    if (precision != Precision::kFp16) return;
    collector.run("remodulate", method, precision, "values beyond 16 bits, 1 x 1",
                  [&](Check& check) { check_saturation(check, collector.target(), method); });
  });
}

}  // namespace raymeld::conform
