#include <fmt/format.h>

#include <array>
#include <limits>

#include "conform/frame_image.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::Fill;
using reference::Planes;
using reference::Precision;
using reference::Size;

// Returns the exposure's factor and inverse as the device wrote them.
Planes found(Check& check, const Target& target, const Planes& lrhs, float key, size_t layout,
             Precision precision) {
  const FrameImage frame(target.device, lrhs, frame_layouts()[layout]);
  LayerRun run(target, precision);
  exposure(run.graph(), "exposure", kLrhsSlot, uint32_t(lrhs.h), uint32_t(lrhs.w), key);
  run.run(frame.frame(kLrhsSlot), 7);
  check.that(frame.touched_outside() == 0, "wrote outside the image");
  const Exposure written = run.exposure();
  return {2, 1, 1, {written.factor, written.inverse}};
}

// Checks colors of one brightness; with `specials` about half of the values are special. A second run must
// give the same bits.
void check_random(Check& check, const Target& target, const Size& size, double brightness, bool specials,
                  size_t seed, Precision precision) {
  const Fill fill = specials ? Fill::kSpecials : Fill::kUniform;
  Planes lrhs = reference::random_planes(3, size.h, size.w, fill, seed);
  for (double& value : lrhs.data)
    if (std::abs(value) < 1) value = float(std::abs(value) * brightness);
  const float key = seed % 2 ? 0.18f : 0.04f;
  const size_t layout = seed % frame_layouts().size();
  const Planes once = found(check, target, lrhs, key, layout, precision);
  check.within(once, reference::exposure(lrhs, key));
  check.same_bits(found(check, target, lrhs, key, layout, precision), once, "second run");
}

// Checks images of one value, whose exposure is known.
void check_flat(Check& check, const Target& target, Precision precision) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  struct Case {
    float value;
    double exposure;
  };
  const Case cases[] = {
      {.value = 0.25f, .exposure = 1},
      {.value = 1, .exposure = 0.25},
      {.value = 16, .exposure = 0x1p-6},
      {.value = 0, .exposure = 1},
      {.value = -0.0f, .exposure = 1},
      {.value = -3, .exposure = 1},
      {.value = kNaN, .exposure = 1},
      {.value = -kInfinity, .exposure = 1},
      {.value = kInfinity, .exposure = 0.25 / 65504},
      {.value = 3e38f, .exposure = 0.25 / 65504},
      {.value = 0x1p-26f, .exposure = 0x1p24},
      {.value = 0x1p-60f, .exposure = 0x1p24},
  };
  for (const auto& [value, exposure] : cases) {
    Planes lrhs(3, 5, 31);
    std::ranges::fill(lrhs.data, value);
    const bool clamped = exposure == 1 || exposure == 0x1p24;
    const double share = clamped && value != 0.25f ? 0 : 1e-5;
    check.within(
        found(check, target, lrhs, 0.25f, 0, precision),
        {Planes(2, 1, 1, {exposure, 1 / exposure}), Planes(2, 1, 1, {share * exposure, share / exposure})},
        fmt::format("every value {:g}", value));
  }
}

}  // namespace

void conform_exposure(Collector& collector) {
  Collector::for_each(plain_methods().first(1), [&](const Method& method, Precision precision) {
    collector.run("exposure", method, precision, "images of one value, 3 x 5 x 31",
                  [&](Check& check) { check_flat(check, collector.target(), precision); });
    std::vector<Size> sizes(collector.sizes().begin(), collector.sizes().end());
    sizes.insert(sizes.end(), {{129, 131}, {150, 401}});  // more pixels than invocations
    size_t seed = 0;
    for (const Size& size : sizes) {
      const double brightness = std::array{1.0, 1e-5, 3e4, 40.0}[seed % 4];
      const bool specials = ++seed % 3 == 0;
      collector.run(
          "exposure", method, precision,
          fmt::format("brightness {:g}{}, layout {}, 3 x {} x {}", brightness,
                      specials ? " and specials" : "", seed % frame_layouts().size(), size.h, size.w),
          [&, seed](Check& check) {
            check_random(check, collector.target(), size, brightness, specials, seed, precision);
          });
    }
  });
}

}  // namespace raymeld::conform
