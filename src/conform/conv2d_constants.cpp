// Tests convolutions with input channels that have one value everywhere and are in no tensor.
#include <fmt/format.h>

#include <array>

#include "conform/conv2d_trials.h"

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

struct ConstantTrial {
  uint32_t kernel = 3, shuffle = 1;       // unshuffles by this before, and shuffles by it after a 3x3
  std::vector<bool> front, second_input;  // true: the channel is constant
  int outputs = 9;
};

// Constants are first, last and side by side, one of them is 0, and they are in both inputs.
const std::array kTrials{
    ConstantTrial{.front = {true, false, false, true, true}, .second_input = {false, true, false, true}},
    ConstantTrial{.shuffle = 2, .front = {false, true, true, false}, .second_input = {}, .outputs = 12},
    ConstantTrial{.kernel = 1, .front = {true, false, true, false}, .second_input = {}},
    ConstantTrial{.kernel = 1, .shuffle = 2, .front = {false, true, false, true}, .second_input = {}}};

std::string text_of(const ConstantTrial& trial, const Size& size) {
  return fmt::format("{}{} -> {} channels{}, some constant, {} x {}", trial.front.size(),
                     trial.second_input.empty() ? "" : fmt::format(" and {}", trial.second_input.size()),
                     trial.outputs,
                     trial.shuffle == 1  ? ""
                     : trial.kernel == 1 ? ", unshuffled by 2"
                                         : ", unshuffled and shuffled by 2",
                     size.h, size.w);
}

// Holds the channels of an input; some have one value everywhere.
struct Channels {
  Planes all, in_tensor;
  std::vector<std::optional<float>> constants;
};

Channels channels_of(const std::vector<bool>& constant, const Size& size, Fill fill, uint64_t seed,
                     Precision precision) {
  Channels result{round_to(random_planes(int(constant.size()), size.h, size.w, fill, seed), precision),
                  Planes(0, size.h, size.w),
                  {}};
  const auto plane = ptrdiff_t(size.h) * size.w;
  for (size_t c = 0; c < constant.size(); ++c) {
    const auto first = result.all.data.begin() + ptrdiff_t(c) * plane;
    if (constant[c]) {
      const double value = c == 3 ? 0 : *first;
      std::fill_n(first, plane, value);
      result.constants.push_back(float(value));
    } else {
      result.in_tensor.data.insert(result.in_tensor.data.end(), first, first + plane);
      ++result.in_tensor.c;
      result.constants.push_back(std::nullopt);
    }
  }
  return result;
}

// Holds a convolution in a run and its expected result.
struct ConstantConvolved {
  Tensor out;
  Bounded expected;
};

ConstantConvolved add(LayerRun& run, const ConstantTrial& trial, const Size& size, Fill fill, uint64_t seed,
                      const Method& method, Precision precision) {
  const int s = int(trial.shuffle), back = trial.kernel == 1 ? 1 : s;
  const Size full{s * size.h, s * size.w};
  Channels in = channels_of(trial.front, full, fill, seed, precision);
  Conv2dOptions options{.kernel = trial.kernel,
                        .relu = true,
                        .unshuffle = trial.shuffle,
                        .shuffle = uint32_t(back),
                        .how = method.kernel};
  const Tensor front = run.input("in", in.in_tensor);
  Bounded x = exact(in.all);
  if (!trial.second_input.empty()) {
    const Channels second = channels_of(trial.second_input, full, fill, seed + 1, precision);
    options.second_input = run.input("second", second.in_tensor);
    x = reference::concat(x, exact(second.all));
    in.constants.insert(in.constants.end(), second.constants.begin(), second.constants.end());
  }
  options.constants = in.constants;
  if (s > 1) x = reference::space_to_depth(x, s);
  const Conv conv =
      round_to(random_conv(trial.outputs, x.value.c, int(trial.kernel), fill, seed + 2), precision);
  const Tensor out = run.tensor("out", trial.outputs / back / back, back * size.h, back * size.w);
  conv2d(run.graph(), "conv", front, out, run.weights(conv), options);
  const Bounded y = reference::conv2d(x, conv, true, precision, {}, method.tile(), method.units(precision));
  return {out, back > 1 ? reference::pixel_shuffle(y, back) : y};
}

}  // namespace

void run_constants(Collector& collector) {
  for (const ConstantTrial& trial : kTrials) {
    const std::vector<Method> methods = conv2d_methods(collector.device().info(), trial.kernel);
    Collector::for_each(methods, [&](const Method& method, Precision precision) {
      for (const Size& size : collector.sizes()) {
        const uint64_t seed = uint64_t(size.h * 1000 + size.w);
        collector.run(trial.kernel == 1 ? "conv2d 1x1" : "conv2d 3x3", method, precision,
                      text_of(trial, size), [&](Check& check) {
                        // F(4, 3) divides weights by multiples of 3, so its sums are not whole numbers.
                        const bool integers = method.tile().down != 4;
                        LayerRun run(collector.target(), precision, method.addressed);
                        const ConstantConvolved random =
                            add(run, trial, size, Fill::kUniform, seed, method, precision);
                        ConstantConvolved whole;
                        if (integers) whole = add(run, trial, size, Fill::kIntegers, seed, method, precision);
                        run.run();
                        check.within(run.read(random.out), random.expected, "random");
                        if (integers)
                          check.within(run.read(whole.out), exact(whole.expected.value), "integers");
                      });
      }
    });
  }
}

}  // namespace raymeld::conform
