// raymeld_bench takes the options of Google Benchmark. RAYMELD_BENCH_DEVICE chooses the device, and
// frames.cpp says what RAYMELD_BENCH_MODELS, RAYMELD_BENCH_SIZES and RAYMELD_BENCH_FRAME do.
#include <fmt/format.h>

#include <cstdlib>
#include <random>

#include "bench.h"
#include "error.h"
#include "platform/folders.h"

namespace raymeld::bench {

const Device& device() {
  static const auto device =
      Device::create({std::getenv("RAYMELD_BENCH_DEVICE") ? std::getenv("RAYMELD_BENCH_DEVICE") : ""});
  return *device;
}

PipelineCache& cache() {
  static PipelineCache cache(device(), default_cache_folder());
  return cache;
}

std::vector<float> random_values(size_t count, uint32_t seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> distribution(-0.1f, 0.1f);
  std::vector<float> values(count);
  for (float& value : values) value = distribution(generator);
  return values;
}

const std::vector<Conv2dShape>& shapes() {
  static const std::vector<Conv2dShape> all{
      {.height = 128, .width = 128, .channels_in = 64, .channels_out = 64, .kernel = 3},
      {.height = 128, .width = 128, .channels_in = 320, .channels_out = 64, .kernel = 1},
      {.height = 128, .width = 128, .channels_in = 64, .channels_out = 256, .kernel = 3},
      {.height = 512, .width = 512, .channels_in = 64, .channels_out = 64, .kernel = 3},
      {.height = 512, .width = 512, .channels_in = 18, .channels_out = 64, .kernel = 3},
      {.height = 128, .width = 128, .channels_in = 432, .channels_out = 24, .kernel = 3},
      {.height = 128, .width = 128, .channels_in = 40, .channels_out = 16, .kernel = 3},
      {.height = 128, .width = 128, .channels_in = 72, .channels_out = 24, .kernel = 1},
      {.height = 512, .width = 512, .channels_in = 43, .channels_out = 16, .kernel = 3},
      {.height = 512, .width = 512, .channels_in = 16, .channels_out = 16, .kernel = 3},
      {.height = 512, .width = 512, .channels_in = 16, .channels_out = 8, .kernel = 3},
      {.height = 512, .width = 512, .channels_in = 64, .channels_out = 3, .kernel = 3},
  };
  return all;
}

std::string name_of(const Conv2dShape& s) {
  return fmt::format("{0}x{0}/{1}x{2}/{3}-{4}", s.kernel, s.height, s.width, s.channels_in, s.channels_out);
}

}  // namespace raymeld::bench

int main(int argc, char** argv) try {
  using namespace raymeld::bench;
  register_device();
  register_convolutions();
  register_frames();
#ifdef RAYMELD_ONEDNN
  register_onednn();
#endif
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::AddCustomContext("device", device().info().name);
  benchmark::AddCustomContext("driver", device().info().driver);
  benchmark::RunSpecifiedBenchmarks();
  cache().save();
  return 0;
} catch (const raymeld::Error& error) {
  std::fprintf(stderr, "raymeld_bench: %s\n", error.what());
  return 2;
}
