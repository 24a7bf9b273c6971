#include "conform/image_trial.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;
using reference::Size;

Planes albedo(const ImageTrial& c, const Size& of, uint64_t salt) {
  return c.image(3, of, salt, [](double u) { return u; });
}

// Returns the light of radiance up to the clip.
Planes lights(const ImageTrial& c, const Size& of, uint64_t salt) {
  return c.image(3, of, salt, [&](double u) { return std::log1p(0.2 * c.clip() * std::pow(u, 4)) / 0.2; });
}

// Most logits are from -4 to 4, and some are -90 or 90.
Planes logits(const ImageTrial& c, int channels, const Size& of, uint64_t salt) {
  return c.image(channels, of, salt, [](double u) { return u == 0 ? -90 : u == 1 ? 90 : 8 * u - 4; });
}

// A decimated LRHS has a phase of 0.
void check_light(Check& check, const ImageTrial& c) {
  const Planes color = c.radiance(3, c.full(), 1), surface = albedo(c, c.full(), 2);
  const Planes lrhs = c.radiance(3, c.size, 3);
  constexpr float kCertainty = 10;
  for (const bool decimated : {false, true}) {
    if (decimated && c.phase > 0) continue;
    const auto with = [&](const auto& given) { return decimated ? std::optional(given) : std::nullopt; };
    const Planes out =
        run_layer(c, {color, surface, lrhs}, c.full(), [&](Graph& graph, const auto& in, const Tensor& to) {
          light(graph, "light", in[0], in[1], to, c.transfer(),
                with(Decimated{in[2], uint32_t(c.scale), kCertainty}));
        });
    const Bounded low = exact(lrhs);
    check.within(out,
                 reference::light(exact(color), exact(surface), c.expected_transfer(), c.precision,
                                  with(reference::Decimated{low, c.scale, kCertainty})),
                 decimated ? "with LRHS" : "");
  }
}

void check_cell_light(Check& check, const ImageTrial& c) {
  const Planes lrhs = c.radiance(3, c.size, 1), surface = albedo(c, c.full(), 2);
  const Planes out =
      run_layer(c, {lrhs, surface}, c.size, [&](Graph& graph, const auto& in, const Tensor& to) {
        cell_light(graph, "cell_light", in[0], in[1], to, c.transfer(), uint32_t(c.scale), c.phase);
      });
  check.within(out, reference::cell_light(exact(lrhs), exact(surface), c.expected_transfer(), c.scale,
                                          c.phase, c.precision));
}

void check_pool(Check& check, const ImageTrial& c) {
  const int channels = c.seed % 2 == 0 ? 9 : 12;
  const Planes in = c.image(channels, c.enlarged(2), 1, [](double u) { return 20 * u - 2; });
  const Planes other = lights(c, c.size, 2);
  const Planes shares = c.image(1, c.size, 3, [](double u) { return u; });
  const Bounded moved = exact(other), by = exact(shares);
  for (const float share : {0.0f, 0.2f, 1.0f, -1.0f}) {  // -1: each pixel has its own
    const auto add = [&](Graph& graph, const auto& tensors, const Tensor& to) {
      std::optional<Blend> blend;
      if (share > 0) blend = {.other = tensors[1], .share = share};
      if (share < 0) blend = {.other = tensors[1], .shares = tensors[2]};
      pool(graph, "pool", tensors[0], to, blend);
    };
    const Planes out = run_layer(c, {in, other, shares}, c.size, add, 9);
    check.within(
        out,
        reference::pool(exact(in), c.precision, share != 0 ? &moved : nullptr, share,
                        share < 0 ? &by : nullptr),
        fmt::format("{} channels, share {}", channels, share < 0 ? "by pixel" : fmt::format("{}", share)));
  }
}

// Returns albedo and normal.
Planes guides(const ImageTrial& c, const Size& of, uint64_t salt) {
  return concat(albedo(c, of, salt), c.image(3, of, salt + 1, [](double u) { return 2 * u - 1; }));
}

void check_kernel_filter(Check& check, const ImageTrial& c, bool is_blended, bool is_guided) {
  const Size size = c.enlarged(2);
  const Planes in = lights(c, size, 1), coarse = lights(c, c.size, 2), surfaces = guides(c, size, 4);
  const int side = 1 + 2 * int(c.seed % 4);
  const Planes weights = logits(c, side * side + is_blended + 2 * is_guided, size, 3);
  const Planes out = run_layer(
      c, {in, weights, coarse, surfaces}, size, [&](Graph& graph, const auto& tensors, const Tensor& to) {
        KernelInputs inputs;
        if (is_blended) inputs.coarse = tensors[2];
        if (is_guided) inputs.guides = tensors[3];
        kernel_filter(graph, "kernel_filter", tensors[0], tensors[1], to, uint32_t(side), inputs);
      });
  const Bounded smaller = exact(coarse), surface = exact(surfaces);
  check.within(out,
               reference::kernel_filter(exact(in), exact(weights), side, c.precision,
                                        is_blended ? &smaller : nullptr, is_guided ? &surface : nullptr),
               fmt::format("{} x {} pixels{}{}", side, side, is_blended ? ", blended" : "",
                           is_guided ? ", guided" : ""));
}

void check_kernel_filters(Check& check, const ImageTrial& c) {
  for (const bool is_blended : {false, true}) {
    for (const bool is_guided : {false, true}) check_kernel_filter(check, c, is_blended, is_guided);
  }
}

void check_compose(Check& check, const ImageTrial& c) {
  const Size full = c.full();
  const Planes residual = c.image(3, full, 1, [](double u) { return u - 0.5; });
  const Planes rec = concat(residual, logits(c, 12, full, 2)), filtered = lights(c, full, 3);
  const Planes surface = guides(c, full, 6), lrhs = c.radiance(3, c.size, 5);
  const Planes out =
      run_layer(c, {rec, filtered, surface, lrhs}, full, [&](Graph& graph, const auto& in, const Tensor& to) {
        compose(graph, "compose", in[0], in[1], in[2], in[3], to, c.transfer(), uint32_t(c.scale), c.phase);
      });
  check.within(out, reference::compose(exact(rec), exact(filtered), exact(surface), exact(lrhs),
                                       c.expected_transfer(), c.scale, c.phase, c.precision));
}

constexpr ImageLayer kPyramidLayers[] = {{.name = "light", .check = check_light},
                                         {.name = "cell_light", .check = check_cell_light},
                                         {.name = "pool", .check = check_pool},
                                         {.name = "kernel_filter", .check = check_kernel_filters},
                                         {.name = "compose", .check = check_compose}};

}  // namespace

void conform_pyramid(Collector& collector) { try_layers(collector, kPyramidLayers); }

}  // namespace raymeld::conform
