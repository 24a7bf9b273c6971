#include "choice/frame_times.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <random>

#include "fusion/fuser.h"
#include "io/json_file.h"

namespace raymeld {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kFrameTimesVersion = 4;
constexpr size_t kFurtherFrames = 3;

std::filesystem::path file_of(const Device& device, const std::filesystem::path& folder) {
  if (folder.empty()) return {};
  return folder /
         fmt::format("times-{}-{}lanes.json", device_key(device.properties()), device.info().subgroup_size);
}

std::map<std::string, FrameTime> load(const std::filesystem::path& file) try {
  const Json json = load_json_file(file, kFrameTimesVersion);
  std::map<std::string, FrameTime> times;
  if (json.is_null()) return times;
  for (const auto& [key, time] : json.at("times_ms").items())
    times[key] = {time.at("first"), time.at("further")};
  return times;
} catch (const Json::exception&) {
  return {};
}

Json to_json(const std::map<std::string, FrameTime>& times) {
  Json json = Json::object();
  for (const auto& [key, time] : times) json[key] = {{"first", time.first_ms}, {"further", time.further_ms}};
  return {{"times_ms", json}};
}

// Returns a text of everything that a frame's time depends on and that differs within one file.
std::string key_of(const Model& model, const FusePlan& plan, const FuserOptions& options) {
  const Tiling& tiling = plan.tiling;
  // This shape tells direct kernels from others.
  const Conv2dKernel kernel = options.kernels.conv2d({64, 64, 32, 32, 3});
  const char* kernels = kernel.algorithm == Algorithm::kDirect ? "direct kernels" : "fast kernels";
  const size_t layers =
      image_layers(model.architecture(), options.constants, options.compute_variance).size();
  return fmt::format("{}, {} parameters, {} layers, {}x{} in {} tiles, {}, {}", model.name(),
                     model.parameters(), layers, tiling.frame.width, tiling.frame.height, tiling.count(),
                     options.storage == Storage::kFloat16 ? "fp16" : "fp32", kernels);
}

// Returns noise, or an empty image for a render that the model does not read.
Image noise(const Shape& shape, uint32_t seed) {
  if (shape.channels == 0) return {};
  Image image(int(shape.width), int(shape.height), int(shape.channels));
  std::minstd_rand random(seed);
  for (float& value : image.data) value = float(random() % 1024) / 1024;
  return image;
}

FrameTime measure_frame(const Device& device, const Model& model, TileSize frame, const FuserOptions& options,
                        const std::filesystem::path& folder, const MillisecondClock& now_ms) {
  const auto shapes = frame_shapes(model, frame, options.constants, options.compute_variance);
  const Image lrhs = noise(shapes[0], 1), hrls = noise(shapes[1], 2);
  const auto make = [&] { return Fuser(device, model, frame.height, frame.width, options, folder); };
  Image fused;
  // Some drivers compile a kernel when it first runs, and keep it for all programs.
  make().fuse(lrhs, hrls, fused);
  fused = {};  // a program's first frame allocates the image
  const double begin_ms = now_ms();
  Fuser fuser = make();
  fuser.fuse(lrhs, hrls, fused);
  const double first_ms = now_ms() - begin_ms;
  const auto time_ms = [&] {
    const double start_ms = now_ms();
    fuser.fuse(lrhs, hrls, fused);
    return now_ms() - start_ms;
  };
  std::array<double, kFurtherFrames> further_ms;
  std::ranges::generate(further_ms, time_ms);
  std::ranges::sort(further_ms);
  return {first_ms, further_ms[kFurtherFrames / 2]};
}

// Returns the size of a frame of that shape, but of no more than `most_pixels` fused pixels.
TileSize measured_size(const Model& model, uint32_t height, uint32_t width, double most_pixels) {
  const double pixels = double(height) * width * model.architecture().scale * model.architecture().scale;
  const double side = std::min(1.0, std::sqrt(most_pixels / pixels));
  return {std::max(1u, uint32_t(height * side)), std::max(1u, uint32_t(width * side))};
}

}  // namespace

double steady_ms() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double, std::milli>(now).count();
}

FrameTimes::FrameTimes(const Device& device, const std::filesystem::path& folder, MillisecondClock clock,
                       double most_pixels)
    : device_(device),
      folder_(folder),
      file_(file_of(device, folder)),
      clock_(std::move(clock)),
      most_pixels_(most_pixels),
      times_(load(file_)) {}

std::optional<FrameTime> FrameTimes::known(const Model& model, uint32_t height, uint32_t width,
                                           FuserOptions options) const {
  options.temporal = false;  // as measure() does
  const auto found =
      times_.find(key_of(model, plan_fusion(model, height, width, device_.info(), options), options));
  return found == times_.end() ? std::nullopt : std::optional(found->second);
}

FrameTime FrameTimes::measure(const Model& model, uint32_t height, uint32_t width, FuserOptions options) {
  // A history takes about a tenth of the time beside these.
  options.keep_activations = options.profile = options.skip_unchanged = options.temporal = false;
  const FusePlan whole = plan_fusion(model, height, width, device_.info(), options);
  const TileSize size = measured_size(model, height, width, most_pixels_);
  const double part = plan_fusion(model, size.height, size.width, device_.info(), options).flop / whole.flop;
  FrameTime time = measure_frame(device_, model, size, options, folder_, clock_);
  time.first_ms /= part, time.further_ms /= part;
  times_[key_of(model, whole, options)] = time;
  if (!file_.empty()) save_json_file(file_, kFrameTimesVersion, to_json(times_));
  return time;
}

void FrameTimes::forget(const Device& device, const std::filesystem::path& folder) {
  std::error_code error;
  if (!folder.empty()) std::filesystem::remove(file_of(device, folder), error);
}

}  // namespace raymeld
