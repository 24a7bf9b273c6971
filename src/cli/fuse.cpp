#include "cli/fuse.h"

#include <fmt/ranges.h>

#include "cli/interrupt.h"
#include "exposure.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

void check_written(const FuseArguments& arguments, const Model& model) {
  std::vector<fs::path> inputs = arguments.inputs(), outputs = arguments.outputs();
  inputs.push_back(model.file());
  if (!arguments.dump.empty()) {
    // A folder that is there already is asked through a name inside it.
    std::error_code error;
    const fs::path dump = arguments.dump_folder();
    const bool is_folder = fs::is_directory(dump, error);
    if (!is_folder && fs::exists(dump, error)) {
      throw Error("--dump '{}': there is a file of that name, and it has to be a folder", arguments.dump);
    }
    outputs.push_back(is_folder ? dump / "decode.npy" : dump);
  }
  check_outputs(outputs, inputs);
}

const char* sampling_name(const FuseFiles& files) { return files.phase == 0 ? "nearest" : "centered"; }

// What the model was not made for, or does without; each line ends with \n.
std::string notices(const FuseFiles& files) {
  std::string text;
  for (const std::string& layer : files.absent_layers) {
    text += fmt::format("HRLS has no layer {}; model {} does without it\n", layer, files.model.name());
  }
  if (!files.model.architecture().trained_on(files.phase > 0)) {
    text += fmt::format("model {} was not trained on {} LRHS\n", files.model.name(), sampling_name(files));
  }
  return text;
}

std::string describe(const FuseFiles& files) {
  return notices(files) +
         fmt::format("LRHS {}: color from {}; {} samples\nHRLS {}: {}model {}, scale {}: takes {}",
                     files.lrhs.path().string(), fmt::join(files.lrhs_map.layers.at("color").terms[0], ", "),
                     sampling_name(files), files.hrls.path().string(), raymeld::describe(files.hrls_map),
                     files.model.name(), files.canvas.scale,
                     fmt::join(files.model.architecture().hrls_layers, ", "));
}

// Of the fused frame, or of one that would be.
Json facts(const FuseFiles& files, const DeviceInfo& device, Storage storage, const Tiling& tiling,
           float exposure) {
  return {{"device", device.name},
          {"model", files.model.name()},
          {"precision", precision_name(storage)},
          {"scale", files.canvas.scale},
          {"width", width_of(files.hrls_windows.data)},
          {"height", height_of(files.hrls_windows.data)},
          {"lrhs_sampling", sampling_name(files)},
          {"absent_layers", files.absent_layers},
          {"input_exposure", exposure},
          {"tiles", tiling.count()}};
}

float find_exposure(const FuseArguments& arguments, FuseFiles& files, Console& console) {
  const float key = files.model.architecture().exposure_key;
  if (arguments.input_exposure != 0) return arguments.input_exposure;
  if (key == 0) return 1;
  const Image lrhs = load_lrhs(files, console);
  return exposure_of(lrhs.data.data(), lrhs.plane_size(), key);
}

void show_plan(const FuseArguments& arguments, FuseFiles& files, const Device& device, Console& console) {
  const float exposure = find_exposure(arguments, files, console);
  const FuserOptions options = fuser_options(arguments, files, device, arguments.threshold.value_or(0));
  const FusePlan plan = plan_fusion(files.model, uint32_t(height_of(files.canvas.lrhs)),
                                    uint32_t(width_of(files.canvas.lrhs)), device.info(), options);
  const Tiling& tiling = plan.tiling;
  if (arguments.json) {
    Json json = facts(files, device.info(), options.storage, tiling, exposure);
    json["tile_width"] = tiling.tile.width, json["tile_height"] = tiling.tile.height;
    json["halo"] = tiling.halo;
    json["gflop"] = plan.flop * 1e-9;
    json["peak_bytes"] = plan.peak_bytes();
    json["activation_bytes"] = plan.graph.activation_bytes();
    json["unaliased_bytes"] = plan.graph.unaliased_bytes();
    json["layers"] = {{"lrhs", to_json(files.lrhs_map)}, {"hrls", to_json(files.hrls_map)}};
    json["hrls_layers"] = files.model.architecture().hrls_layers;
    print(json.dump(2) + "\n");
    return;
  }
  print(fmt::format("{}\ninput exposure {:.4g}\ndevice {} ({})\n", describe(files), exposure,
                    device.info().name, precision_name(options.storage)));
  print(fmt::format("{} tile(s) of {} x {} LRHS pixels, halo {}; {:.3f} GFLOP, {:.1f} % of it for halos\n",
                    tiling.count(), tiling.tile.width, tiling.tile.height, tiling.halo, plan.flop * 1e-9,
                    100 - 100 / tiling.overhead()));
  print(fmt::format(
      "memory {:.1f} MiB: weights {:.1f}, activations {:.1f} ({:.1f} without aliasing), frame {:.1f}\n",
      double(plan.peak_bytes()) / kMebibyte, double(plan.graph.constant_bytes()) / kMebibyte,
      double(plan.graph.activation_bytes()) / kMebibyte, double(plan.graph.unaliased_bytes()) / kMebibyte,
      double(plan.frame_bytes) / kMebibyte));
}

QualityTable measure_all(const FuseImages& images, const Comparison& comparison, const Image& fused) {
  return {{"fused", measure(fused, *images.reference)},
          {"bicubic_lrhs", measure(comparison.bicubic, *images.reference)},
          {"hrls", measure(comparison.hrls, *images.reference)}};
}

std::string json_text(const FuseFiles& files, const DeviceInfo& device, const FuseResult& result,
                      const QualityTable& quality, const Console& console, double total_ms) {
  Json json = facts(files, device, result.storage, result.tiling, result.report.exposure);
  json["redone_tiles"] = result.report.redone_tiles;
  json["settled_share"] = result.report.settled_share;
  json["work_share"] = result.report.work_share;
  json["device_ms"] = result.report.device_ms;
  json["total_ms"] = total_ms;
  json["peak_bytes"] = result.allocated_bytes;
  json["metrics"] = to_json(quality);
  json["warnings"] = to_json(console.warnings());
  if (!result.report.layers.empty()) {
    json["layers"] = to_json(result.report.layers);
    json["kernels"] = to_json(result.report.kernels);
  }
  return json.dump(2) + "\n";
}

std::string report_text(const FuseReport& report, const QualityTable& quality) {
  return (report.layers.empty() ? "" : profile_text(report)) + (quality.empty() ? "" : table(quality));
}

}  // namespace

void run_fuse(const FuseArguments& arguments) {
  const Stopwatch watch;
  Console console(!arguments.quiet && !arguments.json);
  FuseFiles files = open_files(arguments);
  if (arguments.dry_run) {
    return show_plan(arguments, files, *Device::create({.selector = arguments.device}), console);
  }
  check_written(arguments, files.model);
  console.note(describe(files));
  FuseImages images = load_images(arguments, files, console);
  check_interrupted();

  const auto device = Device::create({.selector = arguments.device});
  StagedFiles staged;
  const FuseResult result = run_frame(arguments, files, images, *device, console, staged);
  std::optional<Comparison> comparison;
  if (images.reference || !arguments.before_after.empty()) comparison = make_comparison(files, images);
  write_outputs(arguments, files, images, comparison, result, console, staged);
  const QualityTable quality =
      images.reference ? measure_all(images, *comparison, result.fused) : QualityTable{};
  print(arguments.json ? json_text(files, device->info(), result, quality, console, watch.ms())
                       : report_text(result.report, quality));
  staged.commit();
  if (result.report.settled_share > 0) {
    console.note(
        fmt::format("{:.0f} % of the frame is the same in LRHS and HRLS and needed no network; {:.0f} % of "
                    "the work was done",
                    100 * result.report.settled_share, 100 * result.report.work_share));
  }
  console.note(fmt::format(
      "wrote {}: input exposure {:.4g}, {:.0f} ms on the device, {:.0f} ms in all, {:.0f} MiB of its memory",
      arguments.output, result.report.exposure, result.report.device_ms, watch.ms(),
      double(result.allocated_bytes) / kMebibyte));
}

}  // namespace raymeld::cli
