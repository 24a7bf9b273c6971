#include <fmt/format.h>

#include <array>
#include <optional>

#include "conform/conv2d_trials.h"
#include "conform/suites.h"
#include "reference/winograd.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::Conv;
using reference::exact;
using reference::Fill;
using reference::Planes;
using reference::Precision;
using reference::random_conv;
using reference::random_planes;
using reference::Size;
using reference::slice;

struct Trial {
  int in, out;
  bool relu;
  int residuals;
  int second_input = 0;  // of the input channels, in a tensor of their own
};

// Odd channel counts around the shader's blocks of 4 and 8, every kernel with every number of residuals.
constexpr std::array k3x3{Trial{1, 1, false, 0},   Trial{3, 8, true, 0},     Trial{9, 5, false, 2},
                          Trial{18, 8, true, 0},   Trial{2, 16, true, 3},    Trial{24, 3, false, 0},
                          Trial{9, 5, true, 1, 4}, Trial{7, 4, false, 3, 1}, Trial{19, 9, true, 1}};
constexpr std::array k1x1{Trial{4, 3, false, 3}, Trial{8, 4, true, 2}, Trial{7, 17, false, 1},
                          Trial{16, 12, true, 0}, Trial{11, 9, false, 1, 7}};

std::string text_of(const Trial& s, const Size& size) {
  return fmt::format("{}{} -> {} channels{}, {} residuals, {} x {}",
                     s.second_input > 0 ? fmt::format("{} and ", s.in - s.second_input) : "",
                     s.second_input > 0 ? s.second_input : s.in, s.out, s.relu ? ", ReLU" : "", s.residuals,
                     size.h, size.w);
}

Bounded expected(const Bounded& x, const Conv& conv, bool relu, Precision precision,
                 const std::vector<Bounded>& residuals, const Method& method) {
  std::vector<const Bounded*> pointers;
  for (const Bounded& residual : residuals) pointers.push_back(&residual);
  return reference::conv2d(x, conv, relu, precision, pointers, method.tile(), method.units());
}

// What a trial is filled with: `factor` is that of weights, bias and residuals.
struct Values {
  Fill fill = Fill::kUniform;
  double factor = 1;
};

// Values whose sums are whole numbers. F(4, 3) divides weights by 24 in both directions, and sums up so much
// that its inputs and weights are -1, 0 and 1 of these.
Values whole_values(const Method& method) {
  return method.tile() == 4 ? Values{Fill::kSigns, 24 * 24} : Values{Fill::kIntegers};
}

// A convolution of one trial in a run, and what it must give.
struct Convolved {
  Tensor out;
  Bounded expected;
  Planes in_floats;   // as a scalar computation has it
  Planes magnitudes;  // S of F(4, 3)
};

Convolved add_values(LayerRun& run, const Trial& trial, uint32_t kernel, const Size& size,
                     const Values& values, uint64_t seed, const Method& method, Precision precision) {
  Conv conv = round_to(random_conv(trial.out, trial.in, int(kernel), values.fill, seed), precision);
  for (double& v : conv.weight) v *= values.factor;
  for (double& v : conv.bias) v *= values.factor;
  const Planes x = round_to(random_planes(trial.in, size.h, size.w, values.fill, seed + 1), precision);
  const int in_front = trial.in - trial.second_input;
  const Tensor in = run.input("in", slice(exact(x), 0, in_front).value);
  const Tensor out = run.tensor("out", trial.out, size.h, size.w);
  std::optional<Tensor> second;
  if (trial.second_input > 0)
    second = run.input("second", slice(exact(x), in_front, trial.second_input).value);
  std::vector<Tensor> residuals;
  std::vector<Bounded> bounded;
  for (int i = 0; i < trial.residuals; ++i) {
    Planes residual =
        round_to(random_planes(trial.out, size.h, size.w, values.fill, seed + 2 + uint64_t(i)), precision);
    for (double& v : residual.data) v *= values.factor;
    residuals.push_back(run.input(fmt::format("residual {}", i), residual));
    bounded.push_back(exact(residual));
  }
  conv2d(run.graph(), "conv", in, out, run.weights(conv),
         {.kernel = kernel,
          .relu = trial.relu,
          .residuals = residuals,
          .second_input = second,
          .how = method.kernel});
  std::vector<const Planes*> pointers;
  for (const Bounded& residual : bounded) pointers.push_back(&residual.value);
  return {out, expected(exact(x), conv, trial.relu, precision, bounded, method),
          reference::conv2d_in_floats(x, conv, trial.relu, precision, pointers, method.tile()),
          method.tile() == 4 ? reference::winograd_magnitudes(exact(x), conv, 4) : Planes()};
}

// Within the bound, and with the RMS error of a scalar computation.
void check_random(Check& check, const LayerRun& run, const Convolved& random, const Method& method,
                  Precision precision) {
  const Planes actual = run.read(random.out), &truth = random.expected.value;
  check.within(actual, random.expected, "random");
  check.rms(actual, truth, method.units() * reference::allowed_rms(truth, random.in_floats, precision),
            "random");
}

// Every partial sum is a whole number that a float holds, so no rounding is left.
void check_whole(Check& check, const LayerRun& run, const Convolved& whole) {
  check.within(run.read(whole.out), exact(whole.expected.value), "integers");
  for (const double s : whole.magnitudes.data)
    if (s >= 0x1p24) return check.that(false, fmt::format("integers: sums of {} are not exact", s));
}

// Random values within bounds, small integers exactly; as two convolutions of one graph, so that a driver
// compiles their kernel once.
void check_values(Check& check, const Target& target, const Trial& trial, uint32_t kernel, const Size& size,
                  uint64_t seed, const Method& method, Precision precision) {
  LayerRun run(target, precision, method.addressed);
  const Convolved random = add_values(run, trial, kernel, size, {}, seed, method, precision);
  const Convolved whole = add_values(run, trial, kernel, size, whole_values(method), seed, method, precision);
  run.run();
  check_random(check, run, random, method, precision);
  check_whole(check, run, whole);
}

// Reads channels of a tensor and writes others of it, whose neighbours stay as they were.
void check_slices(Check& check, const Target& target, const Method& method, Precision precision,
                  uint32_t kernel) {
  const Planes wide = round_to(random_planes(13, 9, 7, Fill::kUniform, 1), precision);
  const Conv conv = round_to(random_conv(3, 5, int(kernel), Fill::kUniform, 2), precision);
  LayerRun run(target, precision, method.addressed);
  const Tensor all = run.input("features", wide);
  conv2d(run.graph(), "dense", all.slice(2, 5), all.slice(8, 3), run.weights(conv),
         {.kernel = kernel, .how = method.kernel});
  run.run();
  const Bounded before = exact(wide), after = exact(run.read(all));
  check.within(slice(after, 8, 3).value, expected(slice(before, 2, 5), conv, false, precision, {}, method));
  check.same_bits(slice(after, 0, 8).value, slice(before, 0, 8).value, "the channels in front");
  check.same_bits(slice(after, 11, 2).value, slice(before, 11, 2).value, "the channels after it");
}

// Of an unshuffled image, to be shuffled; with residuals where the shuffle is no pass of its own.
void check_shuffled(Check& check, const Target& target, const Method& method, Precision precision) {
  const int r = 2, in_channels = 2, out_channels = 3, h = 5, w = 35;
  const Planes x = round_to(random_planes(in_channels, r * h, r * w, Fill::kUniform, 1), precision);
  const Planes y = round_to(random_planes(out_channels, r * h, r * w, Fill::kUniform, 2), precision);
  const Conv conv =
      round_to(random_conv(r * r * out_channels, r * r * in_channels, 3, Fill::kUniform, 3), precision);
  LayerRun run(target, precision, method.addressed);
  const Tensor in = run.input("in", x), out = run.tensor("out", out_channels, r * h, r * w);
  std::vector<Tensor> residuals;
  std::vector<Bounded> bounded;
  if (method.kernel.algorithm != Algorithm::kDirect) {
    residuals.push_back(run.input("residual", y));
    bounded.push_back(reference::space_to_depth(exact(y), r));
  }
  conv2d(run.graph(), "conv", in, out, run.weights(conv),
         {.kernel = 3,
          .relu = true,
          .residuals = residuals,
          .unshuffle = r,
          .shuffle = r,
          .how = method.kernel});
  run.run();
  const Bounded deep = reference::space_to_depth(exact(x), r);
  check.within(run.read(out),
               reference::pixel_shuffle(expected(deep, conv, true, precision, bounded, method), r));
}

// A 1x1 of an unshuffled image, a slice of a tensor; by vectors it gives the bits of lane by lane.
void check_cells(Check& check, const Target& target, const Method& method, Precision precision, int r) {
  const int before = 1, in_channels = 3, out_channels = 13, h = 3, w = 19;
  const Planes x = round_to(random_planes(before + in_channels, r * h, r * w, Fill::kUniform, 1), precision);
  const Conv conv = round_to(random_conv(out_channels, r * r * in_channels, 1, Fill::kUniform, 2), precision);
  LayerRun run(target, precision, method.addressed);
  const Tensor in = run.input("in", x).slice(before, in_channels);
  const auto add = [&](uint32_t vector) {
    const Tensor out = run.tensor("out", out_channels, h, w);
    run.graph().read_vectors(vector);
    conv2d(run.graph(), "conv", in, out, run.weights(conv),
           {.kernel = 1, .relu = true, .unshuffle = uint32_t(r), .how = method.kernel});
    return out;
  };
  const Tensor out = add(method.kernel.vector);
  std::optional<Tensor> lanes;
  if (method.kernel.vector > 0) lanes = add(0);
  run.run();
  const Bounded deep = reference::space_to_depth(slice(exact(x), before, in_channels), r);
  check.within(run.read(out), expected(deep, conv, true, precision, {}, method));
  if (lanes) check.same_bits(run.read(out), run.read(*lanes), "lane by lane");
}

// Rows of whole vectors, several of them; the bits are those of lane by lane.
void check_vectors(Check& check, const Target& target, const Method& method, Precision precision) {
  const Trial trial{9, 7, true, 1, 4};
  Method lane_by_lane = method;
  lane_by_lane.kernel.vector = 0;
  LayerRun run(target, precision, method.addressed);
  const Size size{10, 128};
  const Convolved vectors = add_values(run, trial, 3, size, {}, 1, method, precision);
  const Convolved lanes = add_values(run, trial, 3, size, {}, 1, lane_by_lane, precision);
  run.run();
  check.within(run.read(vectors.out), vectors.expected);
  check.same_bits(run.read(vectors.out), run.read(lanes.out), "lane by lane");
}

// Every size with one trial, every trial with some sizes; then what depends on no trial. What takes long is
// to compile kernels, so a quick test has two trials, of which each way has one in 32 bits and the other in
// 16, and the rest is tried in 32 bits by one way and in 16 by the next.
void run_values(Collector& collector, std::span<const Trial> trials, uint32_t kernel,
                const std::string& layer) {
  const std::vector<Method> methods = conv2d_methods(collector.device().info(), kernel);
  Collector::for_each(methods, [&](const Method& method, Precision precision) {
    size_t turn = size_t(&method - methods.data()) + size_t(precision == Precision::kFp16);
    const auto own = collector.full() ? trials : trials.subspan(trials.size() - 2 + turn % 2, 1);
    size_t next = precision == Precision::kFp16 ? own.size() / 2 : 0;
    for (const Size& size : collector.sizes()) {
      const Trial& trial = own[next % own.size()];
      const uint64_t seed = 10 * ++next;
      collector.run(layer, method, precision, text_of(trial, size), [&](Check& check) {
        check_values(check, collector.target(), trial, kernel, size, seed, method, precision);
      });
    }
    const auto run = [&](const std::string& shape, const auto& check_shape) {
      if (!collector.full() && turn++ % 2 == 0) return;
      collector.run(layer, method, precision, shape,
                    [&](Check& check) { check_shape(check, collector.target(), method, precision); });
    };
    run("slices of one tensor, 5 -> 3 of 13 channels, 9 x 7",
        [&](auto&&... arguments) { check_slices(arguments..., kernel); });
    if (kernel == 1) {
      for (const int r : {2, 4, 8}) {
        run(fmt::format("of space to depth by {}, {} -> 13 channels, ReLU, 3 x 19", r, 3 * r * r),
            [&](auto&&... arguments) { check_cells(arguments..., r); });
      }
      return;
    }
    run("of space to depth, to pixel shuffle, 8 -> 12 channels, 5 x 35", check_shuffled);
    if (method.kernel.vector > 0)
      run("rows of whole vectors, 5 and 4 -> 7 channels, ReLU, 1 residual, 10 x 128", check_vectors);
  });
}

}  // namespace

std::vector<Method> conv2d_methods(const DeviceInfo& device, uint32_t kernel) {
  std::vector<Method> methods{{.name = "direct"}};
  for (const uint32_t tile : kernel == 1 ? std::vector<uint32_t>{4} : std::vector<uint32_t>{2, 4}) {
    const std::string name = kernel == 1 ? "pointwise" : fmt::format("F({}, 3)", tile);
    for (const bool addressed : {false, true}) {
      // So small that there are several parts, blocks and bands.
      methods.push_back({name + (addressed ? " by address" : ""),
                         {.algorithm = kernel == 1 ? Algorithm::kPointwise : Algorithm::kWinograd,
                          .tile = tile,
                          .outputs = 5,
                          .channels = 4,
                          .band = 12,
                          .order = 2},
                         addressed});
    }
    if (device.vector_lanes > 0) {
      methods.push_back({name + " by vectors", methods.back().kernel, true});
      methods.back().kernel.vector = device.vector_lanes;
    }
  }
  for (const MatrixTiles& tiles : matrix_tiles(device, kernel)) {
    const bool possible = is_possible(tiles, kernel);
    methods.push_back({.name = possible ? fmt::format("matrices, {} outputs", tiles.outputs) : "matrices",
                       .kernel = {.algorithm = Algorithm::kMatrix, .matrix = tiles}});
  }
  return methods;
}

void conform_conv2d(Collector& collector) {
  run_values(collector, k3x3, 3, "conv2d 3x3");
  run_values(collector, k1x1, 1, "conv2d 1x1");
  run_specials(collector);
  run_constants(collector);
}

}  // namespace raymeld::conform
