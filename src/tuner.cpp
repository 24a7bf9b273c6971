#include "tuner.h"

#include <algorithm>
#include <chrono>
#include <random>

#include "engine/commands.h"
#include "engine/program.h"
#include "numbers.h"

namespace raymeld {
namespace {

std::vector<float> random_weights(size_t count) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> distribution(-0.1f, 0.1f);
  std::vector<float> values(count);
  for (float& value : values) value = distribution(generator);
  return values;
}

double milliseconds_of(const Device& device, VkCommandBuffer commands) {
  const auto start = std::chrono::steady_clock::now();
  device.submit_and_wait(commands);
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// Mesa's driver for CPUs loads a value for each lane with one instruction since version 24; before, lane by lane.
bool gathers(const DeviceInfo& device) {
  const size_t at = device.driver.find("Mesa ");
  return at == std::string::npos || std::atoi(device.driver.c_str() + at + 5) >= 24;
}

}  // namespace

std::vector<Conv2dKernel> conv2d_candidates(const Conv2dShape& shape, const DeviceInfo& device) {
  std::vector<Conv2dKernel> result{{}};
  if (!device.buffer_device_address) return result;
  const std::vector<uint32_t> tiles = shape.kernel == 1 ? std::vector<uint32_t>{1} : std::vector<uint32_t>{2, 4};
  for (const bool addressed : {false, true}) {
    for (const uint32_t tile : tiles) {
      for (const uint32_t outputs : {16u, 24u}) {
        result.push_back({.tile = tile, .addressed = addressed, .outputs = outputs, .channels = 64, .order = 8, .band = 256});
      }
    }
  }
  return result;
}

double time_conv2d(const Device& device, PipelineCache& cache, Storage storage, const Conv2dShape& shape,
                   const Conv2dKernel& kernel, double budget_ms) {
  const std::vector<float> weight =
      random_weights(size_t{shape.channels_out} * shape.channels_in * shape.kernel * shape.kernel);
  const std::vector<float> bias = random_weights(shape.channels_out);
  uint32_t rows = std::min(shape.height, 32u);
  for (;;) {
    Graph graph(storage);
    const Tensor in = graph.input("in", {rows, shape.width, shape.channels_in});
    const Tensor out = graph.tensor("out", {rows, shape.width, shape.channels_out});
    conv2d(graph, "conv2d", in, out, {weight, bias}, {.kernel = shape.kernel, .relu = true, .how = kernel});
    graph.plan();
    Program program(device, graph, cache, 1);
    program.write(in, random_weights(in.shape.pixels() * in.shape.channels));
    Commands pool(device);
    const VkCommandBuffer commands = pool.begin("conv2d");
    program.record(commands, 0, 0, graph.passes().size());
    pool.end(commands);
    milliseconds_of(device, commands);
    std::vector<double> times;
    double total = 0;
    while (times.size() < 3 || (total < budget_ms && times.size() < 15)) {
      times.push_back(milliseconds_of(device, commands));
      total += times.back();
    }
    std::nth_element(times.begin(), times.begin() + ptrdiff_t(times.size() / 2), times.end());
    const double median = times[times.size() / 2];
    if (rows == shape.height || median > budget_ms / 5) return median * shape.height / rows;
    rows = std::min(shape.height, 2 * rows);
  }
}

Conv2dChoice default_conv2d_choice(const DeviceInfo& device) {
  if (!device.is_cpu || !device.buffer_device_address) return conv2d_direct;
  const bool addressed = gathers(device);
  return [=](const Conv2dShape& shape) {
    return Conv2dKernel{.tile = shape.kernel == 1 ? 1u : 4u, .addressed = addressed};
  };
}

}  // namespace raymeld
