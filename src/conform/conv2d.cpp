#include <fmt/format.h>

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
  bool relu = false;
  int residuals = 0;
  int second_input = 0;  // number of input channels in a second tensor
};

// Channel counts lie around the shaders' blocks of 4 and 8. Each kernel size has each number of residuals.
constexpr Trial k3x3[] = {
    {.in = 1, .out = 1},
    {.in = 3, .out = 8, .relu = true},
    {.in = 9, .out = 5, .residuals = 2},
    {.in = 18, .out = 8, .relu = true},
    {.in = 2, .out = 16, .relu = true, .residuals = 3},
    {.in = 24, .out = 3},
    {.in = 9, .out = 5, .relu = true, .residuals = 1, .second_input = 4},
    {.in = 7, .out = 4, .residuals = 3, .second_input = 1},
    {.in = 19, .out = 9, .relu = true, .residuals = 1},
};
constexpr Trial k1x1[] = {
    {.in = 4, .out = 3, .residuals = 3},
    {.in = 8, .out = 4, .relu = true, .residuals = 2},
    {.in = 7, .out = 17, .residuals = 1},
    {.in = 16, .out = 12, .relu = true},
    {.in = 11, .out = 9, .residuals = 1, .second_input = 7},
};

constexpr Trial k5x5[] = {
    {.in = 3, .out = 9, .relu = true},
    {.in = 10, .out = 4, .residuals = 1, .second_input = 3},
    {.in = 11, .out = 16},
};

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
  return reference::conv2d(x, conv, relu, precision, pointers, method.tile(), method.units(precision));
}

// Says how a trial is filled. Weights, bias and residuals are multiplied by `factor`.
struct Values {
  Fill fill = Fill::kUniform;
  double factor = 1;
};

// Returns values whose sums are whole numbers. F(4, 3) divides weights by 24 in each direction, so they are
// multiples of 24 * 24. Its sums grow so large that inputs and multiples are -1, 0 and 1 only.
Values whole_values(const Method& method) {
  return method.tile().down == 4 ? Values{.fill = Fill::kSigns, .factor = 24 * 24}
                                 : Values{.fill = Fill::kIntegers};
}

// Holds a trial's convolution in a run and its expected results.
struct Convolved {
  Tensor out;
  Bounded expected;
  Planes in_floats;   // the result of a scalar computation in floats
  Planes magnitudes;  // winograd_magnitudes() of F(4, 3)
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
          method.tile().down == 4 ? reference::winograd_magnitudes(exact(x), conv, method.tile()) : Planes()};
}

// Compares values with their bounds, and their RMS error with that of a scalar computation.
void check_random(Check& check, const LayerRun& run, const Convolved& random, const Method& method,
                  Precision precision) {
  const Planes actual = run.read(random.out), &truth = random.expected.value;
  check.within(actual, random.expected, "random");
  check.rms(actual, truth,
            method.units(precision) * reference::allowed_rms(truth, random.in_floats, precision), "random");
}

// Every partial sum is a whole number that a float holds, so no rounding is left.
void check_whole(Check& check, const LayerRun& run, const Convolved& whole) {
  check.within(run.read(whole.out), exact(whole.expected.value), "integers");
  for (const double s : whole.magnitudes.data)
    if (s >= 0x1p24) return check.that(false, fmt::format("integers: sums of {} are not exact", s));
}

// Compares random values with their bounds, and small integers exactly. Both convolutions are in one graph,
// so that a driver compiles their kernel once.
void check_values(Check& check, const Target& target, const Trial& trial, uint32_t kernel, const Size& size,
                  uint64_t seed, const Method& method, Precision precision) {
  LayerRun run(target, precision, method.addressed);
  const Convolved random = add_values(run, trial, kernel, size, {}, seed, method, precision);
  const Convolved whole = add_values(run, trial, kernel, size, whole_values(method), seed, method, precision);
  run.run();
  check_random(check, run, random, method, precision);
  check_whole(check, run, whole);
}

// Reads some channels of a tensor and writes others, whose neighbours must stay as they were.
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
  check.same_bits(slice(after, 0, 8).value, slice(before, 0, 8).value, "channels before the output");
  check.same_bits(slice(after, 11, 2).value, slice(before, 11, 2).value, "channels after the output");
}

// Unshuffles the input of a convolution by r, unless its kernel is pointwise, and shuffles its output.
void check_shuffled(Check& check, const Target& target, const Method& method, Precision precision,
                    uint32_t kernel, int r) {
  const int in_channels = 2, out_channels = 3, h = 5, w = 35;
  const int unshuffle = method.kernel.algorithm == Algorithm::kPointwise ? 1 : r;
  const Planes x =
      round_to(random_planes(in_channels, unshuffle * h, unshuffle * w, Fill::kUniform, 1), precision);
  const Planes y = round_to(random_planes(out_channels, r * h, r * w, Fill::kUniform, 2), precision);
  const Conv conv = round_to(
      random_conv(r * r * out_channels, unshuffle * unshuffle * in_channels, int(kernel), Fill::kUniform, 3),
      precision);
  LayerRun run(target, precision, method.addressed);
  const Tensor in = run.input("in", x), out = run.tensor("out", out_channels, r * h, r * w);
  conv2d(run.graph(), "conv", in, out, run.weights(conv),
         {.kernel = kernel,
          .relu = true,
          .residuals = {run.input("residual", y)},
          .unshuffle = uint32_t(unshuffle),
          .shuffle = uint32_t(r),
          .how = method.kernel});
  run.run();
  const Bounded deep = unshuffle > 1 ? reference::space_to_depth(exact(x), unshuffle) : exact(x);
  const Bounded residual = reference::space_to_depth(exact(y), r);
  check.within(run.read(out),
               reference::pixel_shuffle(expected(deep, conv, true, precision, {residual}, method), r));
}

// Unshuffles a slice of a tensor for a 1x1 convolution, with the same bits by vectors and lane by lane.
void check_pointwise_unshuffled(Check& check, const Target& target, const Method& method, Precision precision,
                                int r) {
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
  if (lanes) check.same_bits(run.read(out), run.read(*lanes), "by vectors and lane by lane");
}

// Computes rows of several whole vectors, with the same bits by vectors and lane by lane.
void check_vectors(Check& check, const Target& target, const Method& method, Precision precision,
                   uint32_t kernel) {
  const Trial trial{.in = 9, .out = 7, .relu = true, .residuals = 1, .second_input = 4};
  Method lane_by_lane = method;
  lane_by_lane.kernel.vector = 0;
  LayerRun run(target, precision, method.addressed);
  const Size size{10, 128};
  const Convolved vectors = add_values(run, trial, kernel, size, {}, 1, method, precision);
  const Convolved lanes = add_values(run, trial, kernel, size, {}, 1, lane_by_lane, precision);
  run.run();
  check.within(run.read(vectors.out), vectors.expected);
  check.same_bits(run.read(vectors.out), run.read(lanes.out), "by vectors and lane by lane");
}

// Runs every size with one trial, every trial with some sizes, and then the cases that depend on no trial.
// Compiling kernels takes most of the time. So a quick test has two trials, and each method runs one of them
// in 32 bits and the other in 16. It runs each of the other cases in 32 bits with one method and in 16 bits
// with the next.
void run_values(Collector& collector, std::span<const Trial> trials, uint32_t kernel,
                const std::string& layer) {
  const std::vector<Method> methods =
      conv2d_methods(collector.device().info(), kernel, collector.options().extent);
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
    for (const int r : {2, 4, 8}) {
      // A kernel of 5 that is shuffled by 8 takes so much work that a CPU's driver gets it in several
      // dispatches. Validation takes these, which write one buffer side by side, for a hazard.
      if (kernel == 5 && r == 8) continue;
      run(fmt::format("shuffled by {}, ReLU, 1 residual, 5 x 35", r),
          [&](auto&&... arguments) { check_shuffled(arguments..., kernel, r); });
    }
    if (kernel == 1) {
      for (const int r : {2, 4, 8}) {
        run(fmt::format("unshuffled by {}, {} -> 13 channels, ReLU, 3 x 19", r, 3 * r * r),
            [&](auto&&... arguments) { check_pointwise_unshuffled(arguments..., r); });
      }
      return;
    }
    if (method.kernel.vector > 0) {
      run("rows of whole vectors, 5 and 4 -> 7 channels, ReLU, 1 residual, 10 x 128",
          [&](auto&&... arguments) { check_vectors(arguments..., kernel); });
    }
  });
}

}  // namespace

std::vector<Method> conv2d_methods(const DeviceInfo& device, uint32_t kernel, Extent extent) {
  std::vector<Method> methods{direct_method(device)};
  for (const uint32_t tile : kernel == 3 ? std::vector<uint32_t>{2, 4} : std::vector<uint32_t>{})
    methods.push_back(columns_method(tile));
  for (const uint32_t tile : kernel == 1 ? std::vector<uint32_t>{4} : std::vector<uint32_t>{2, 4}) {
    const std::string name = kernel == 1 ? "pointwise" : fmt::format("F({}, 3)", tile);
    for (const bool addressed : {false, true}) {
      // These parameters are so small that there are several parts, blocks and bands.
      methods.push_back({.name = name + (addressed ? " by address" : ""),
                         .kernel = {.algorithm = kernel == 1 ? Algorithm::kPointwise : Algorithm::kWinograd,
                                    .tile = tile,
                                    .outputs = 5,
                                    .channels = 4,
                                    .band = 12,
                                    .order = 2},
                         .addressed = addressed});
    }
    if (device.vector_lanes > 0) {
      methods.push_back({.name = name + " by vectors", .kernel = methods.back().kernel, .addressed = true});
      methods.back().kernel.vector = device.vector_lanes;
    }
  }
  if (kernel == 5) return methods;
  const bool compiles_slowly = kernel == 3 && device.type == "CPU" && extent == Extent::kQuick;
  for (const MatrixTiles& tiles : matrix_tiles(device, kernel)) {
    if (compiles_slowly && tiles.outputs > tiles.matrix.m) continue;
    const bool possible = is_possible(tiles, kernel);
    methods.push_back({.name = possible ? fmt::format("matrices, {} outputs", tiles.outputs) : "matrices",
                       .kernel = {.algorithm = Algorithm::kMatrix, .matrix = tiles}});
  }
  return methods;
}

void conform_conv2d(Collector& collector) {
  run_values(collector, k3x3, 3, "conv2d 3x3");
  run_values(collector, k1x1, 1, "conv2d 1x1");
  run_values(collector, k5x5, 5, "conv2d 5x5");
  run_specials(collector);
}

}  // namespace raymeld::conform
