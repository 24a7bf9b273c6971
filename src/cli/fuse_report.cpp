// What the program says of a frame: notes, text and JSON.
#include <fmt/ranges.h>

#include "cli/choice.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

using Json = nlohmann::ordered_json;

const char* sampling_name(const FuseFiles& files) { return files.phase == 0 ? "nearest" : "centered"; }

// What the model was not made for, or does without; each line ends with \n.
std::string notices(const FuseFiles& files) {
  std::string text;
  for (const auto& [layer, zeros] : files.absent_layers) {
    text += fmt::format("HRLS has no layer {}; model {} does without it\n", layer, files.model->name());
  }
  if (!files.model->architecture().trained_on(files.phase > 0)) {
    text += fmt::format("model {} was not trained on {} LRHS\n", files.model->name(), sampling_name(files));
  }
  return text;
}

// Empty where all of HRLS is fused.
std::string window_text(const FuseFiles& files) {
  const Imath::Box2i& window = files.window;
  if (window == files.hrls_windows.data) return "";
  return fmt::format("window: {} x {} pixels at {},{}\n", width_of(window), height_of(window), window.min.x,
                     window.min.y);
}

std::vector<std::string> names_of(const ConstantLayers& layers) {
  std::vector<std::string> names;
  for (const auto& [layer, values] : layers) names.push_back(layer);
  return names;
}

// Operations, or bytes, in `time_ms`, in thousands of millions a second; 0 where no time was measured.
double giga_per_second(double count, double time_ms) { return time_ms > 0 ? count / time_ms * 1e-6 : 0; }

std::string row(const std::string& name, double time_ms, double flop, double bytes) {
  return fmt::format("{:<30} {:>12.3f} {:>10.2f} {:>10.2f}\n", name, time_ms, giga_per_second(flop, time_ms),
                     giga_per_second(bytes, time_ms));
}

const char* rule_name(LayerRule rule) {
  switch (rule) {
    case LayerRule::kRead:
      return "read";
    case LayerRule::kEquation2:
      return "color * (direct + indirect)";
    case LayerRule::kSum:
      return "sum";
    case LayerRule::kVariance:
      return "variance";
  }
  return "";
}

std::string profile_text(const FuseReport& report) {
  std::string text;
  PassTime total;
  for (const auto& [what, times] : {std::pair("layer", &report.layers), {"kernel", &report.kernels}}) {
    text += fmt::format("{:<30} {:>12} {:>10} {:>10}\n", what, "ms", "GFLOP/s", "GB/s");
    total = {};
    for (const PassTime& time : *times) {
      text += row(time.name, time.time_ms, time.flop, time.bytes);
      total.time_ms += time.time_ms;
      total.flop += time.flop;
      total.bytes += time.bytes;
    }
  }
  return text + row("total", total.time_ms, total.flop, total.bytes);
}

Json to_json(const std::vector<PassTime>& times) {
  auto json = Json::array();
  for (const PassTime& time : times) {
    json.push_back({{"name", time.name},
                    {"ms", time.time_ms},
                    {"gflop_per_s", giga_per_second(time.flop, time.time_ms)},
                    {"gb_per_s", giga_per_second(time.bytes, time.time_ms)}});
  }
  return json;
}

}  // namespace

Json to_json(const LayerMap& map) {
  auto json = Json::object();
  for (const auto& [layer, source] : map.layers)
    json[layer] = {{"rule", rule_name(source.rule)}, {"channels", source.terms}};
  return json;
}

ConstantLayers found_constants(const FuseFrame& frame) {
  ConstantLayers found = frame.images.constants;
  for (const auto& [layer, zeros] : frame.files.absent_layers) found.erase(layer);
  return found;
}

std::string describe(const FuseArguments& arguments, const FuseFiles& files) {
  return notices(files) +
         fmt::format("LRHS {}: color from {}; {} samples\nHRLS {}: {}{}model {}, scale {}: takes {}",
                     arguments.lrhs, fmt::join(files.lrhs_map.layers.at("color").terms[0], ", "),
                     sampling_name(files), arguments.hrls, raymeld::describe(files.hrls_map),
                     window_text(files), files.model->name(), files.canvas.scale,
                     fmt::join(files.model->architecture().hrls_layers, ", "));
}

// Of the fused frame, or of one that would be.
Json facts(const FuseFiles& files, const DeviceInfo& device, Storage storage, const Tiling& tiling,
           float exposure) {
  return {{"device", device.name},
          {"model", files.model->name()},
          {"precision", precision_name(storage)},
          {"scale", files.canvas.scale},
          {"x", files.window.min.x},
          {"y", files.window.min.y},
          {"width", width_of(files.window)},
          {"height", height_of(files.window)},
          {"lrhs_sampling", sampling_name(files)},
          {"absent_layers", names_of(files.absent_layers)},
          {"input_exposure", exposure},
          {"tiles", tiling.count()}};
}

std::string frame_text(const FuseFrame& frame, const QualityTable& quality) {
  const FuseReport& report = frame.result.report;
  return (report.layers.empty() ? "" : profile_text(report)) + (quality.empty() ? "" : table(quality));
}

Json frame_json(const FuseFrame& frame, const DeviceInfo& device, const QualityTable& quality,
                double total_ms) {
  const FuseResult& result = frame.result;
  Json json = facts(frame.files, device, result.storage, result.tiling, result.report.exposure);
  if (frame.arguments.choice) json["choice"] = to_json(*frame.arguments.choice);
  json["constant_layers"] = found_constants(frame);
  json["redone_tiles"] = result.report.redone_tiles;
  json["settled_share"] = result.report.settled_share;
  json["kept_share"] = result.report.kept_share;
  json["work_share"] = result.report.work_share;
  json["device_ms"] = result.report.device_ms;
  json["fuse_ms"] = result.time_ms;
  json["total_ms"] = total_ms;
  json["peak_bytes"] = result.allocated_bytes;
  json["metrics"] = to_json(quality);
  json["warnings"] = to_json(frame.console.warnings());
  if (!result.report.layers.empty()) {
    json["layers"] = to_json(result.report.layers);
    json["kernels"] = to_json(result.report.kernels);
  }
  return json;
}

}  // namespace raymeld::cli
