#include "frame_times.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "fuser.h"
#include "io/atomic_file.h"

namespace raymeld {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kFormatVersion = 1;
constexpr double kMostPixels = 1 << 21;
constexpr size_t kFrames = 3;
constexpr uintmax_t kMostFileBytes = 1 << 20;

std::filesystem::path file_of(const Device& device, const std::filesystem::path& folder) {
  if (folder.empty()) return {};
  return folder /
         fmt::format("times-{}-{}lanes.json", device_key(device.properties()), device.info().subgroup_size);
}

std::map<std::string, double> load(const std::filesystem::path& file) try {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error) || std::filesystem::file_size(file) > kMostFileBytes)
    return {};
  std::ifstream stream(file);
  const Json json = Json::parse(stream);
  if (json.at("format_version") != kFormatVersion) return {};
  return json.at("times_ms").get<std::map<std::string, double>>();
} catch (const std::exception&) {
  return {};
}

// Everything that a frame's time depends on, and that one file has several of.
std::string key_of(const Model& model, const FusePlan& plan, const FuserOptions& options) {
  const Tiling& tiling = plan.tiling;
  const Conv2dKernel kernel = options.kernels.conv2d({64, 64, 32, 32, 3});  // tells direct ones from others
  const char* kernels = kernel.tile == 0 && !kernel.matrix ? "direct kernels" : "fast kernels";
  return fmt::format("{}, {} parameters, {} layers, {}x{} in {} tiles, {}, {}", model.name(),
                     model.parameters(), image_layers(model.architecture(), options.constants).size(),
                     tiling.frame.width, tiling.frame.height, tiling.count(),
                     options.storage == Storage::kFloat16 ? "fp16" : "fp32", kernels);
}

Image noise(const Shape& shape, uint32_t seed) {
  Image image(int(shape.width), int(shape.height), int(shape.channels));
  std::minstd_rand random(seed);
  for (float& value : image.data) value = float(random() % 1024) / 1024;
  return image;
}

double measure_frame(const Device& device, const Model& model, TileSize frame, const FuserOptions& options,
                     const std::filesystem::path& folder) {
  const auto shapes = frame_shapes(model, frame, options.constants);
  const Image lrhs = noise(shapes[0], 1), hrls = noise(shapes[1], 2);
  Fuser fuser(device, model, frame.height, frame.width, options, folder);
  Image fused;
  fuser.fuse(lrhs, hrls, fused);  // some drivers compile a kernel when it first runs
  std::array<double, kFrames> times_ms;
  for (double& time_ms : times_ms) {
    const auto start = std::chrono::steady_clock::now();
    fuser.fuse(lrhs, hrls, fused);
    time_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  }
  std::ranges::sort(times_ms);
  return times_ms[kFrames / 2];
}

// A frame of that shape, but of no more than kMostPixels fused pixels.
TileSize measured_size(const Model& model, uint32_t height, uint32_t width) {
  const double pixels = double(height) * width * model.architecture().scale * model.architecture().scale;
  const double side = std::min(1.0, std::sqrt(kMostPixels / pixels));
  return {std::max(1u, uint32_t(height * side)), std::max(1u, uint32_t(width * side))};
}

}  // namespace

FrameTimes::FrameTimes(const Device& device, const std::filesystem::path& folder)
    : device_(device), folder_(folder), file_(file_of(device, folder)), times_ms_(load(file_)) {}

std::optional<double> FrameTimes::known(const Model& model, uint32_t height, uint32_t width,
                                        const FuserOptions& options) const {
  const auto found =
      times_ms_.find(key_of(model, plan_fusion(model, height, width, device_.info(), options), options));
  return found == times_ms_.end() ? std::nullopt : std::optional(found->second);
}

double FrameTimes::measure(const Model& model, uint32_t height, uint32_t width, FuserOptions options) {
  options.threshold = 0;
  options.keep_activations = options.profile = false;
  if (const auto time_ms = known(model, height, width, options)) return *time_ms;
  const FusePlan whole = plan_fusion(model, height, width, device_.info(), options);
  const TileSize size = measured_size(model, height, width);
  const double part = plan_fusion(model, size.height, size.width, device_.info(), options).flop / whole.flop;
  const double time_ms = measure_frame(device_, model, size, options, folder_) / part;
  times_ms_[key_of(model, whole, options)] = time_ms;
  if (!file_.empty()) save();
  return time_ms;
}

void FrameTimes::save() const {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  const std::string text = Json{{"format_version", kFormatVersion}, {"times_ms", times_ms_}}.dump(1) + "\n";
  AtomicFile out(file_);
  out.write(text.data(), text.size());
  out.commit();
}

void FrameTimes::forget(const Device& device, const std::filesystem::path& folder) {
  std::error_code error;
  if (!folder.empty()) std::filesystem::remove(file_of(device, folder), error);
}

}  // namespace raymeld
