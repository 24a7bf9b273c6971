// Tries the layers that join a frame with the ones before it.
#include <limits>
#include <utility>

#include "conform/frame_image.h"
#include "conform/image_trial.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;
using reference::Size;

// Holds a part of a frame, which lies within it, and the histories of the frame before.
struct Scene {
  static constexpr int kOthers = 3;  // accumulated channels after color, albedo and normal
  static constexpr int kChannels = 9 + kOthers;

  const ImageTrial& c;
  Size frame{c.scale * (c.size.h + 3), c.scale*(c.size.w + 2)};
  int y = 2 * c.scale, x = c.scale;
  float exposure = c.seed % 2 ? 1.0f : 0.25f;
  Planes hrls, lrhs, motion, past_hrls, past_lrhs, past_fused;

  explicit Scene(const ImageTrial& trial) : c(trial) {
    const Planes guides = concat(c.image(3, c.full(), 2, [](double u) { return u; }),
                                 c.image(3, c.full(), 3, [](double u) { return 2 * u - 1; }));
    // Two further channels are not accumulated.
    hrls = concat(concat(c.radiance(3, c.full(), 1), guides), c.radiance(kOthers + 2, c.full(), 4));
    lrhs = c.radiance(3, c.size, 5);
    motion = drawn_motion();
    if (c.seed % 2) motion = concat(motion, drawn_depths());
    const auto past = [&](int channels, const Size& of, uint64_t salt, const auto& value) {
      const Planes image = c.image(channels, of, salt, value);
      return reference::planes(channels, of.h, of.w, reference::floats(image));
    };
    const auto light = [&](double u) { return c.clip() * std::pow(u, 4) / exposure; };
    const auto deviation = [&](double u) { return light(u) / 8; };
    // Most depths are like each other, and some are none.
    const auto depth = [](double u) { return u < 0.1 ? 0 : u < 0.2 ? 1e30 : std::exp(0.4 * u); };
    // A quarter of the pixels have no history.
    const auto frames = [](double u) { return u < 0.25 ? 0 : std::floor(64 * u); };
    past_hrls = concat(past(3, frame, 6, light), past(3, frame, 7, [](double u) { return u; }));
    past_hrls = concat(past_hrls, past(3, frame, 8, [](double u) { return 2 * u - 1; }));
    past_hrls = concat(past_hrls, concat(past(kOthers, frame, 9, light), past_motion()));
    past_hrls = concat(past_hrls, concat(past(1, frame, 14, depth), past(1, frame, 10, frames)));
    const Size small{frame.h / c.scale, frame.w / c.scale};
    const auto left = [](double u) { return u < 0.4 ? 0 : 3 * (u - 0.7); };
    past_lrhs = concat(past(3, small, 11, light), past(1, small, 15, deviation));
    past_lrhs = concat(past_lrhs, concat(past(1, small, 16, left), past(1, small, 12, frames)));
    past_fused = past(3, frame, 13, light);
  }

  // Returns motions that are exact in floats, some of them out of the frame, or no numbers.
  Planes drawn_motion() const {
    Planes result =
        reference::random_planes(2, c.full().h, c.full().w, reference::Fill::kUniform, c.seed + 40);
    for (size_t i = 0; i < result.data.size(); ++i) {
      result.data[i] = std::round(24 * result.data[i]) / 8;
      if (i % 31 == 7) result.data[i] = i % 2 ? 1e9 : std::numeric_limits<double>::quiet_NaN();
    }
    return result;
  }

  // Returns depths in both frames that are exact in floats, some of which are none.
  Planes drawn_depths() const {
    Planes result =
        reference::random_planes(2, c.full().h, c.full().w, reference::Fill::kUniform, c.seed + 41);
    for (size_t i = 0; i < result.data.size(); ++i) {
      result.data[i] = double(float(std::exp(0.2 + 0.2 * result.data[i])));
      if (i % 37 == 5) result.data[i] = i % 2 ? -1 : std::numeric_limits<double>::infinity();
    }
    return result;
  }

  // Returns the motions of the last frame. Where the motion of a pixel leads, they are the same or differ by
  // up to a quarter of a pixel; elsewhere they are other ones.
  Planes past_motion() const {
    Planes result(2, frame.h, frame.w);
    for (size_t i = 0; i < result.data.size(); ++i) result.data[i] = double(i % 7) - 3;
    for (int row = 0; row < motion.h; ++row) {
      for (int column = 0; column < motion.w; ++column) {
        const double to_x = std::floor(x + column + motion.at(0, row, column));
        const double to_y = std::floor(y + row + motion.at(1, row, column));
        if (!(to_x >= 0 && to_x < frame.w && to_y >= 0 && to_y < frame.h)) continue;
        for (int i = 0; i < 2; ++i)
          result.at(i, int(to_y), int(to_x)) = motion.at(i, row, column) + (column % 3) / 8.0;
      }
    }
    return result;
  }

  Place place() const {
    const auto at = [](int value) { return uint32_t(value); };
    return {at(y), at(x), at(frame.h), at(frame.w), at(c.scale), 0, at(c.full().h - c.scale), at(c.full().w)};
  }
  bool is_core(int row, int column) const {
    return row >= c.scale && row < c.full().h && column < c.full().w;
  }
  reference::Past past() const { return {motion, past_hrls, past_lrhs, past_fused, y, x, exposure}; }
};

// Returns all histories of the frame before, as one buffer has them.
Planes past_histories(const Scene& s) {
  std::vector<double> values = s.past_hrls.data;
  for (const Planes* more : {&s.past_fused, &s.past_lrhs})
    values.insert(values.end(), more->data.begin(), more->data.end());
  const auto count = int(values.size());
  return {1, 1, count, std::move(values)};
}

// Returns what add() writes (channels, size), and then the part of the new history that it keeps, which
// begins at `first` with planes of `of`, each of which has `step` full-size pixels a pixel. Values that were
// not written are those of `expected`.
template <typename Add>
Planes run_with_history(Check& check, const Scene& s, const Planes& in, const Size& size, int channels,
                        const Add& add, size_t first, const Size& of, int planes_kept, int step,
                        const Bounded& expected) {
  const Device& device = s.c.target.device;
  const FrameImage motion(device, s.motion, frame_layouts()[s.c.seed % frame_layouts().size()]);
  const Planes past = past_histories(s);
  const FrameImage last(device, past), next(device, Shape{1, uint32_t(past.w), 1});
  FrameBindings frame;
  frame[kMotionSlot] = motion.binding();
  frame[kLastSlot] = last.binding();
  frame[kNextSlot] = next.binding();
  LayerRun run(s.c.target, s.c.precision, s.c.method.addressed);
  const Tensor tensor = run.input("input", in), out = run.tensor("out", channels, size.h, size.w);
  add(run, tensor, out);
  run.run(frame, s.exposure, s.place());

  Planes result(expected.value.c, size.h, size.w);
  const Planes written = run.read(out), kept = next.read();
  const int skipped = channels + planes_kept - expected.value.c;  // channels that the layer does not write
  for (int c = 0; c < result.c - planes_kept; ++c) {
    const int from = c + 1 + planes_kept < result.c ? c : c + skipped;
    for (int y = 0; y < size.h; ++y)
      for (int x = 0; x < size.w; ++x) result.at(c, y, x) = written.at(from, y, x);
  }
  size_t touched = 0, cores = 0;
  for (const double value : kept.data) touched += value != FrameImage::kUntouched;
  for (int c = 0; c < planes_kept; ++c) {
    for (int y = 0; y < size.h; ++y) {
      for (int x = 0; x < size.w; ++x) {
        const int to = result.c - planes_kept + c;
        const size_t at = first + (size_t(c) * size_t(of.h) + size_t(y + s.y / step)) * size_t(of.w) +
                          size_t(x + s.x / step);
        const bool is_core = s.is_core(step * y, step * x);
        result.at(to, y, x) = is_core ? kept.data[at] : expected.value.at(to, y, x);
        cores += is_core;
      }
    }
  }
  check.that(touched == cores,
             fmt::format("{} values of the history were written, expected {}", touched, cores));
  return result;
}

void check_light_change(Check& check, const ImageTrial& c) {
  const Scene s(c);
  const Bounded expected =
      reference::light_change(exact(s.lrhs), s.past(), c.expected_transfer(), c.scale, c.precision);
  const auto add = [&](LayerRun& run, const Tensor& lrhs, const Tensor& out) {
    light_change(run.graph(), "light_change", lrhs, out, c.transfer(), uint32_t(c.scale), Scene::kChannels);
  };
  check.within(
      run_with_history(check, s, s.lrhs, c.size, 2, add, s.past_hrls.data.size() + s.past_fused.data.size(),
                       {s.past_lrhs.h, s.past_lrhs.w}, 6, c.scale, expected),
      expected);
}

void check_accumulate(Check& check, const ImageTrial& c) {
  const Scene s(c);
  // The light has not changed in half of the pixels.
  const Planes change = concat(c.image(1, c.size, 20, [](double u) { return u < 0.5 ? 0 : 3 * (u - 0.75); }),
                               c.image(1, c.size, 21, [](double u) { return u < 0.5 ? 0 : u - 0.5; }));
  const float spp = c.seed % 3 == 0 ? 1.0f : 2.5f;
  for (const bool with_change : {false, true}) {
    const Bounded all = exact(change);
    const Bounded expected = reference::accumulate(exact(s.hrls), s.past(), c.expected_transfer(), c.clip(),
                                                   spp, c.precision, with_change ? &all : nullptr, c.scale);
    const auto add = [&](LayerRun& run, const Tensor& hrls, const Tensor& out) {
      AccumulateOptions options{.transfer = c.transfer(),
                                .clip = float(c.clip()),
                                .spp = spp,
                                .channels = Scene::kChannels,
                                .has_depth = s.motion.c == 4,
                                .scale = uint32_t(c.scale)};
      if (with_change) options.change = run.input("change", change);
      accumulate(run.graph(), "accumulate", hrls, out, options);
    };
    check.within(run_with_history(check, s, s.hrls, c.full(), s.hrls.c + 1, add, 0, s.frame,
                                  Scene::kChannels + 4, 1, expected),
                 expected, with_change ? "with a change of the light" : "");
  }
}

void check_settle(Check& check, const ImageTrial& c) {
  const Scene s(c);
  const Planes fused = c.radiance(3, c.full(), 1),
               samples = c.image(1, c.full(), 2, [](double u) { return 4 * u; });
  const float spp = c.seed % 3 == 0 ? 1.0f : 2.5f;
  const Bounded expected = reference::settle(exact(fused), exact(samples), s.past(), c.expected_transfer(),
                                             c.clip(), spp, c.precision);
  const auto add = [&](LayerRun& run, const Tensor& in, const Tensor& out) {
    settle(run.graph(), "settle", in, run.input("samples", samples), out,
           {.transfer = c.transfer(), .clip = float(c.clip()), .spp = spp, .channels = Scene::kChannels});
  };
  check.within(
      run_with_history(check, s, fused, c.full(), 3, add, s.past_hrls.data.size(), s.frame, 3, 1, expected),
      expected);
}

void check_color_variance(Check& check, const ImageTrial& c) {
  const Planes color = c.radiance(3, c.full(), 1);
  const Planes out = run_layer(c, {color}, c.full(), [&](Graph& graph, const auto& in, const Tensor& to) {
    color_variance(graph, "color_variance", in[0], to, c.transfer(), float(c.clip()));
  });
  check.within(out, reference::color_variance(exact(color), c.expected_transfer(), c.clip(), c.precision));
}

void check_cell_share(Check& check, const ImageTrial& c) {
  const Planes samples = c.image(1, c.full(), 1, [](double u) { return 4 * u; });
  constexpr float kCertainty = 40;
  const Planes out = run_layer(
      c, {samples}, c.size,
      [&](Graph& graph, const auto& in, const Tensor& to) {
        cell_share(graph, "cell_share", in[0], to, uint32_t(c.scale), kCertainty);
      },
      1);
  check.within(out, reference::cell_share(exact(samples), c.scale, kCertainty, c.precision));
}

constexpr ImageLayer kTemporalLayers[] = {{.name = "light_change", .check = check_light_change},
                                          {.name = "accumulate", .check = check_accumulate},
                                          {.name = "settle", .check = check_settle},
                                          {.name = "color_variance", .check = check_color_variance},
                                          {.name = "cell_share", .check = check_cell_share}};

}  // namespace

void conform_temporal(Collector& collector) { try_layers(collector, kTemporalLayers); }

}  // namespace raymeld::conform
