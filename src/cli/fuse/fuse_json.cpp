// Writes the reports on a frame as JSON.
#include "cli/fuse/choice.h"
#include "cli/fuse/fuse_report.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

using Json = nlohmann::ordered_json;

std::vector<std::string> names_of(const ConstantLayers& layers) {
  std::vector<std::string> names;
  for (const auto& [layer, values] : layers) names.push_back(layer);
  return names;
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

Json facts(const FuseFiles& files, const DeviceInfo& device, Storage storage, const Tiling& tiling,
           float exposure) {
  Json json{{"device", device.name},
            {"model", files.model->name()},
            {"precision", precision_name(storage)},
            {"scale", files.frame.scale},
            {"x", files.window.min.x},
            {"y", files.window.min.y},
            {"width", width_of(files.window)},
            {"height", height_of(files.window)}};
  if (files.reads_lrhs())
    json.update({{"lrhs_sampling", sampling_name(files)},
                 {"lrhs_sampling_from", sampling_source(files)},
                 {"lrhs_spp", files.samples.lrhs}});
  if (files.reads_both())
    json.update({{"phase_evidence", files.pair.phase_evidence},
                 {"pair_correlation", files.pair.correlation},
                 {"lrhs_brightness", files.pair.brightness}});
  if (files.reads_hrls())
    json.update({{"hrls_spp", files.samples.hrls}, {"absent_layers", names_of(files.absent_layers)}});
  json.update({{"input_exposure", exposure}, {"tiles", tiling.count()}});
  return json;
}

Json frame_json(const FuseFrame& frame, const DeviceInfo& device, const QualityTable& quality,
                double total_ms) {
  const FuseResult& result = frame.result;
  Json json = facts(frame.files, device, result.storage, result.tiling, result.report.exposure);
  if (frame.arguments.choice) json["choice"] = to_json(*frame.arguments.choice);
  json["constant_layers"] = found_constants(frame);
  json["redone_tiles"] = result.report.redone_tiles;
  json["skipped_share"] = result.report.skipped_share;
  json["device_ms"] = result.report.device_ms;
  json["fuse_ms"] = result.time_ms;
  json["total_ms"] = total_ms;
  for (const Phase& phase : frame.phases) json["phases_ms"][phase.name] = phase.time_ms;
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
