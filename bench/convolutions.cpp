// Measures the device's peak, and one convolution at a time with every kernel.
#include <fmt/format.h>

#include <chrono>

#include "bench.h"
#include "fusion/tuner.h"
#include "layers/shaders.h"

extern const std::span<const uint32_t> k_fma;

namespace raymeld::bench {
namespace {

// Holds a graph's passes, recorded once into a command buffer.
struct Recorded {
  Program program;
  Commands pool;
  VkCommandBuffer commands;

  explicit Recorded(const Graph& graph)
      : program(device(), graph, cache(), 1), pool(device()), commands(pool.begin("benchmark")) {
    program.record(commands, 0, 0, graph.passes().size());
    pool.end(commands);
  }

  // The first run does not count: some drivers compile in it.
  void run(benchmark::State& state) const {
    device().submit_and_wait(commands);
    for ([[maybe_unused]] auto _ : state) {
      const auto start = std::chrono::steady_clock::now();
      device().submit_and_wait(commands);
      state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
  }
};

void rates(benchmark::State& state, double flop, double bytes) {
  using benchmark::Counter;
  state.counters["FLOP/s"] = Counter(flop, Counter::kIsIterationInvariantRate);
  if (bytes > 0) state.counters["bytes/s"] = Counter(bytes, Counter::kIsIterationInvariantRate);
}

struct FmaParams {
  uint32_t rounds;
  float x, y;
};

void peak(benchmark::State& state) {
  constexpr uint32_t kGroups = 64, kLocal = 64, kOfRound = 12 * 80;
  static const Shader shader{"fma", k_fma, k_fma};
  const uint32_t rounds = device().info().is_cpu ? 100 : 2000,
                 groups = device().info().is_cpu ? kGroups : 64 * kGroups;
  Graph graph(Storage::kFloat32);
  Pass pass;
  pass.name = "fma";
  pass.shader = &shader;
  pass.bindings = {write_binding(graph.tensor("sums", {1, groups * kLocal, 1}))};
  pass.set_push(FmaParams{rounds, 0.5f, 0.25f});
  pass.groups = {groups, 1, 1};
  graph.add(std::move(pass));
  graph.plan();
  Recorded(graph).run(state);
  rates(state, 2.0 * kOfRound * rounds * groups * kLocal, 0);
}

void convolution(benchmark::State& state, const Conv2dShape& shape, const Conv2dKernel& kernel,
                 Storage storage, bool addressed) {
  const auto weight =
      random_values(size_t{shape.channels_out} * shape.channels_in * shape.kernel * shape.kernel, 1);
  const auto bias = random_values(shape.channels_out, 2);
  Graph graph(storage, addressed);
  const Tensor in = graph.input("in", {shape.height, shape.width, shape.channels_in});
  const Tensor out = graph.tensor("out", {shape.height, shape.width, shape.channels_out});
  conv2d(graph, "conv2d", in, out, {weight, bias}, {.kernel = shape.kernel, .relu = true, .how = kernel});
  graph.plan();
  Recorded recorded(graph);
  recorded.program.write(in, random_values(in.shape.pixels() * in.shape.channels, 3));
  recorded.run(state);
  double bytes = 0;
  for (const Pass& pass : graph.passes()) bytes += pass.bytes;
  rates(state, shape.flop(), bytes);
}

void add(const std::string& name, const Conv2dShape& shape, const Conv2dKernel& kernel, Storage storage,
         bool addressed) {
  benchmark::RegisterBenchmark(
      name.c_str(), [=](benchmark::State& state) { convolution(state, shape, kernel, storage, addressed); })
      ->UseManualTime()
      ->Unit(benchmark::kMillisecond);
}

// Adds the pointwise kernel of a 1x1 convolution, or the Winograd kernels F(2, 3) and F(4, 3) of others, with
// their other parameters as tuned.
void add_fast(const Conv2dShape& shape, Storage storage) {
  const Kernels tuned = kernels_for(device(), storage);
  const bool winograd = shape.kernel > 1;
  for (const uint32_t tile : winograd ? std::vector<uint32_t>{2, 4} : std::vector<uint32_t>{4}) {
    Conv2dKernel kernel = tuned.conv2d(shape);
    kernel.algorithm = winograd ? Algorithm::kWinograd : Algorithm::kPointwise;
    kernel.tile = tile;
    const std::string kind = winograd ? fmt::format("F({}, 3)", tile) : "pointwise";
    add("conv2d/" + name_of(shape) + "/" + kind + (storage == Storage::kFloat16 ? "/fp16" : ""), shape,
        kernel, storage, tuned.addressed);
  }
}

// Adds the kernels by F(2, 3) and F(4, 3) in columns of a 3x3 convolution.
void add_columns(const Conv2dShape& shape, Storage storage) {
  for (const uint32_t tile : {2u, 4u}) {
    const char* half = storage == Storage::kFloat16 ? "/fp16" : "";
    add(fmt::format("conv2d/{}/columns({}){}", name_of(shape), tile, half), shape,
        {.algorithm = Algorithm::kColumns, .tile = tile}, storage, false);
  }
}

// Adds the kernel of cooperative matrices: the tuned one where tuning chose matrices, else the first guess.
void add_matrix(const Conv2dShape& shape) {
  const CooperativeMatrix& matrix = *device().info().cooperative_matrix;
  const Conv2dKernel tuned = kernels_for(device(), Storage::kFloat16).conv2d(shape);
  add("conv2d/" + name_of(shape) + "/matrix/fp16", shape,
      tuned.algorithm == Algorithm::kMatrix ? tuned : first_matrix_guess(matrix, shape), Storage::kFloat16,
      false);
}

}  // namespace

void register_device() {
  benchmark::RegisterBenchmark("peak", peak)->UseManualTime()->Unit(benchmark::kMillisecond);
}

void register_convolutions() {
  for (const Conv2dShape& shape : shapes()) {
    add("conv2d/" + name_of(shape) + "/direct", shape, {}, Storage::kFloat32, false);
    if (shape.kernel < 5 && device().info().cooperative_matrix && device().info().storage_16bit)
      add_matrix(shape);
    if (shape.kernel == 3 && !device().info().is_cpu) {
      add_columns(shape, Storage::kFloat32);
      if (device().info().storage_16bit) add_columns(shape, Storage::kFloat16);
    }
    if (!device().info().buffer_device_address) continue;
    add_fast(shape, Storage::kFloat32);
    if (device().info().storage_16bit) add_fast(shape, Storage::kFloat16);
  }
}

}  // namespace raymeld::bench
