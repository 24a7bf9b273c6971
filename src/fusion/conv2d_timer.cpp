#include "fusion/conv2d_timer.h"

#include <algorithm>
#include <chrono>
#include <limits>
#include <memory>
#include <random>

#include "engine/commands.h"
#include "engine/program.h"
#include "engine/timestamps.h"
#include "numbers.h"

namespace raymeld {
namespace {

constexpr size_t kLeastRounds = 3, kMostRounds = 15;
constexpr double kCpuBudgetMs = 60, kGpuBudgetMs = 10;  // time of all rounds of a kernel
constexpr double kWarmMs = 20;                          // time that a GPU works before it is measured
constexpr uint32_t kLeastRows = 32;

std::vector<float> random_values(size_t count) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> distribution(-0.1f, 0.1f);
  std::vector<float> values(count);
  for (float& value : values) value = distribution(generator);
  return values;
}

// Describes the first rows of a layer by one kernel.
struct Rows {
  Rows(Storage storage, bool addressed, const Conv2dShape& shape, uint32_t rows, const Conv2dKernel& kernel)
      : share(double(rows) / shape.height),
        weight(random_values(size_t{shape.channels_out} * shape.channels_in * shape.kernel * shape.kernel)),
        bias(random_values(shape.channels_out)),
        graph(storage, addressed) {
    const uint32_t u = shape.unshuffle, s = shape.shuffle;
    in = graph.input("in", {rows * u, shape.width * u, shape.channels_in / (u * u)});
    const Tensor out = graph.tensor("out", {rows * s, shape.width * s, shape.channels_out / (s * s)});
    conv2d(graph, "conv2d", in, out, {weight, bias},
           {.kernel = shape.kernel, .relu = true, .unshuffle = u, .shuffle = s, .how = kernel});
    graph.plan();
  }

  double share;
  std::vector<float> weight, bias;
  Graph graph;
  Tensor in;
};

// Holds a layer by one kernel, recorded once.
class Trial {
 public:
  Trial(const Device& device, PipelineCache& cache, Storage storage, bool addressed, const Conv2dShape& shape,
        uint32_t rows, const Conv2dKernel& kernel)
      : device_(device),
        layer_(storage, addressed, shape, rows, kernel),
        program_(device, layer_.graph, cache, 1),
        pool_(device) {
    program_.fill(layer_.in, 0.1f);
    if (!device.info().is_cpu && device.info().timestamp_period_ns > 0) timestamps_.emplace(device, 1);
    commands_ = pool_.begin("conv2d");
    if (timestamps_) timestamps_->start(commands_);
    program_.record(commands_, 0, 0, layer_.graph.passes().size());
    if (timestamps_) timestamps_->mark(commands_, 0);
    pool_.end(commands_);
  }

  // Runs the layer once; returns the milliseconds that it took.
  double run() const {
    const auto start = std::chrono::steady_clock::now();
    device_.submit_and_wait(commands_);
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
    const auto told = timestamps_ ? timestamps_->pass_ms() : std::nullopt;
    return told ? told->front() : time.count();
  }

  // Returns the share of the layer's rows that a run computes.
  double share() const { return layer_.share; }

 private:
  const Device& device_;
  Rows layer_;
  Program program_;
  std::optional<Timestamps> timestamps_;
  Commands pool_;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
};

// Returns how many rows a GPU computes in one submit without its watchdog ending it.
uint32_t most_rows(const Device& device, const Conv2dShape& shape) {
  const double rows = limits_for(device.info()).submit_work / (shape.flop() / shape.height);
  return uint32_t(std::clamp(rows, 1.0, double(shape.height)));
}

// Compiles all kernels for a GPU at once, with as many threads as the host has, and returns what the trials
// of them find compiled. If one cannot be had, all are left to the trials, of which that one fails.
std::vector<std::shared_ptr<const Kernel>> compile_for_gpu(const Device& device, PipelineCache& cache,
                                                           Storage storage, bool addressed,
                                                           const Conv2dShape& shape,
                                                           std::span<const Conv2dKernel> kernels) {
  std::vector<KernelRecipe> recipes;
  for (const Conv2dKernel& kernel : kernels) {
    try {
      const Rows layer(storage, addressed, shape, most_rows(device, shape), kernel);
      std::ranges::move(kernel_recipes(layer.graph, device.info()), std::back_inserter(recipes));
    } catch (const Error&) {
    }
  }
  try {
    return device.kernels().get(device, cache.handle(), recipes);
  } catch (const Error&) {
    return {};
  }
}

// Makes a trial of so many rows that its time can be measured, and runs it for the first time.
std::unique_ptr<Trial> make_trial(const Device& device, PipelineCache& cache, Storage storage, bool addressed,
                                  const Conv2dShape& shape, const Conv2dKernel& kernel) {
  const uint32_t most = device.info().is_cpu ? shape.height : most_rows(device, shape);
  uint32_t rows = device.info().is_cpu ? std::min(most, kLeastRows) : most;
  while (true) {
    auto trial = std::make_unique<Trial>(device, cache, storage, addressed, shape, rows, kernel);
    trial->run();
    // The rows make at least two bands, so that the size of a band tells.
    const uint32_t side = std::max(kernel.winograd_tile(), 1u);
    const bool has_bands =
        uint64_t{rows / side} * (shape.width / side) >= 2 * kernel.band || !kernel.needs_addresses();
    if (rows == most || (has_bands && trial->run() > kCpuBudgetMs / 6)) return trial;
    rows = std::min(most, 2 * rows);
  }
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Returns the median of each trial's times for the whole layer, infinity where there is no trial.
std::vector<double> time_in_turns(bool is_cpu, const std::vector<std::unique_ptr<Trial>>& trials) {
  std::vector<std::vector<double>> times(trials.size());
  const auto run_all = [&](bool count) {
    double total_ms = 0;
    for (size_t i = 0; i < trials.size(); ++i) {
      if (!trials[i]) continue;
      const double time_ms = trials[i]->run();
      total_ms += time_ms;
      if (count) times[i].push_back(time_ms / trials[i]->share());
    }
    return total_ms;
  };
  if (!is_cpu) {
    for (double total_ms = 0; total_ms < kWarmMs;) total_ms += std::max(run_all(false), 0.1);
  }
  const double budget_ms = (is_cpu ? kCpuBudgetMs : kGpuBudgetMs) * double(trials.size());
  double total_ms = 0;
  for (size_t round = 0; round < kLeastRounds || (round < kMostRounds && total_ms < budget_ms); ++round)
    total_ms += run_all(true);
  std::vector<double> medians;
  for (const auto& of_kernel : times)
    medians.push_back(of_kernel.empty() ? std::numeric_limits<double>::infinity() : median(of_kernel));
  return medians;
}

}  // namespace

std::vector<double> time_conv2d(const Device& device, PipelineCache& cache, Storage storage, bool addressed,
                                const Conv2dShape& shape, std::span<const Conv2dKernel> kernels) {
  std::vector<std::shared_ptr<const Kernel>> compiled;
  if (!device.info().is_cpu) compiled = compile_for_gpu(device, cache, storage, addressed, shape, kernels);
  std::vector<std::unique_ptr<Trial>> trials;
  const auto make_trials = [&] {
    for (const Conv2dKernel& kernel : kernels) {
      try {
        trials.push_back(make_trial(device, cache, storage, addressed, shape, kernel));
      } catch (const DeviceLost&) {
        throw;
      } catch (const Error& error) {
        const bool out_of_memory = dynamic_cast<const OutOfMemory*>(&error);
        if (kernel.algorithm == Algorithm::kDirect || (out_of_memory && kernels.size() > 1)) throw;
        trials.push_back(nullptr);  // others are still tried
      }
    }
  };
  try {
    make_trials();
    return time_in_turns(device.info().is_cpu, trials);
  } catch (const OutOfMemory&) {
    if (kernels.size() == 1) throw;
  }
  // They do not fit the memory side by side.
  trials.clear();
  std::vector<double> times;
  for (const Conv2dKernel& kernel : kernels)
    times.push_back(time_conv2d(device, cache, storage, addressed, shape, {&kernel, 1}).front());
  return times;
}

}  // namespace raymeld
