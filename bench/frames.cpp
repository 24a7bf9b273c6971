// Measures whole frames of the model files in RAYMELD_BENCH_MODELS at the sizes in RAYMELD_BENCH_SIZES. Both
// are lists separated by ':', such as 512x512:1920x1080. Where RAYMELD_BENCH_FRAME names a folder, the inputs
// are its lrhs.raw and hrls.raw, planar floats, and the last output is written to its fused.raw.
#include <fmt/format.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "bench.h"
#include "error.h"
#include "fusion/fuser.h"
#include "fusion/fuser_options.h"

namespace raymeld::bench {
namespace {

using Clock = std::chrono::steady_clock;

std::vector<std::string> listed(const char* variable) {
  std::vector<std::string> items;
  std::stringstream list(std::getenv(variable) ? std::getenv(variable) : "");
  for (std::string item; std::getline(list, item, ':');) items.push_back(item);
  return items;
}

// Reads the peak of this process alone; that of getrusage() includes the process that started it.
double peak_resident_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmHWM:")) return std::atof(line.c_str() + 6) * 1024;
  }
  return 0;
}

double since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

std::vector<float> image(const std::string& name, size_t count, uint32_t seed) {
  const char* folder = std::getenv("RAYMELD_BENCH_FRAME");
  std::vector<float> values = random_values(count, seed);
  for (float& value : values) value = value < 0 ? -value : value;
  if (!folder) return values;
  std::ifstream file(std::string(folder) + "/" + name + ".raw", std::ios::binary);
  file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(float)));
  if (!file) throw Error("{}/{}.raw is not {} floats", folder, name, count);
  return values;
}

void frame(benchmark::State& state, const std::string& file, uint32_t height, uint32_t width,
           Precision precision) {
  const std::string name = fmt::format("{} {}x{} {}", file, height, width, int(precision));
  const auto start = Clock::now();
  const Model model(file);
  const uint32_t scale = model.architecture().scale;
  const FuserOptions options = fuser_options(device(), model, precision, KernelChoice::kAuto);
  Fuser fuser(device(), model, height / scale, width / scale, options);
  const size_t pixels = size_t{height} * width;
  const std::vector<float> lrhs = image("lrhs", pixels / scale / scale * 3, 1),
                           hrls = image("hrls", pixels * 3 * model.architecture().hrls_layers.size(), 2);
  std::vector<float> fused(pixels * 3);
  fuser.fuse(lrhs.data(), hrls.data(), fused.data());
  // Google Benchmark calls this function several times, and drivers compile in the first call. The time does
  // not include making the device.
  static std::map<std::string, double> first_s;
  first_s.try_emplace(name, since(start));
  double device_s = 0, all_s = 0;
  for ([[maybe_unused]] auto _ : state) {
    const auto begin = Clock::now();
    device_s += fuser.fuse(lrhs.data(), hrls.data(), fused.data()).device_ms * 1e-3;
    all_s += since(begin);
    state.SetIterationTime(since(begin));
  }
  using benchmark::Counter;
  state.counters["FLOP/s"] = Counter(fuser.plan().flop, Counter::kIsIterationInvariantRate);
  state.counters["first_s"] = first_s.at(name);
  state.counters["host_share"] = 1 - device_s / all_s;
  state.counters["device_bytes"] = static_cast<double>(fuser.allocated_bytes());
  state.counters["tiles"] = fuser.plan().tiling.count();
  state.counters["rss_bytes"] = peak_resident_bytes();
  if (const char* folder = std::getenv("RAYMELD_BENCH_FRAME")) {
    std::ofstream(std::string(folder) + "/fused.raw", std::ios::binary)
        .write(reinterpret_cast<const char*>(fused.data()),
               static_cast<std::streamsize>(fused.size() * sizeof(float)));
  }
}

}  // namespace

void register_frames() {
  for (const std::string& file : listed("RAYMELD_BENCH_MODELS")) {
    for (const std::string& size : listed("RAYMELD_BENCH_SIZES")) {
      uint32_t width = 0, height = 0;
      if (std::sscanf(size.c_str(), "%ux%u", &width, &height) != 2) throw Error("'{}' is no size", size);
      for (const Precision precision : {Precision::kFp32, Precision::kFp16}) {
        const std::string name = fmt::format("frame/{}/{}/{}", std::filesystem::path(file).stem().string(),
                                             size, precision == Precision::kFp16 ? "fp16" : "fp32");
        benchmark::RegisterBenchmark(
            name.c_str(), [=](benchmark::State& state) { frame(state, file, height, width, precision); })
            ->UseManualTime()
            ->Unit(benchmark::kMillisecond);
      }
    }
  }
}

}  // namespace raymeld::bench
