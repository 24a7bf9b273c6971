#include "cli/fuse.h"

#include <fmt/ranges.h>

#include "cli/interrupt.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kMebibyte = 1048576;

void check_outputs(const FuseArguments& arguments) {
  const std::vector<fs::path> inputs = arguments.inputs();
  for (const fs::path& output : arguments.outputs()) check_output(output, inputs);
  if (arguments.dump.empty()) return;
  // A folder that is there already is asked through a name inside it.
  std::error_code error;
  const fs::path dump = arguments.dump;
  check_output(fs::is_directory(dump, error) ? dump / "decode.npy" : dump, inputs);
}

const char* sampling_name(const FuseFiles& files) { return files.phase == 0 ? "nearest" : "centered"; }

std::string describe(const FuseFiles& files) {
  return fmt::format("LRHS {}: color from {}; {} samples\nHRLS {}: {}model {}, scale {}: takes {}",
                     files.lrhs.path().string(), fmt::join(files.lrhs_map.layers.at("color").terms[0], ", "),
                     sampling_name(files), files.hrls.path().string(), raymeld::describe(files.hrls_map),
                     files.model.name(), files.canvas.scale,
                     fmt::join(files.model.architecture().hrls_layers, ", "));
}

// What text and JSON both begin with.
Json facts(const FuseFiles& files, const DeviceInfo& device, Storage storage, const Tiling& tiling) {
  return {{"device", device.name},
          {"model", files.model.name()},
          {"precision", precision_name(storage)},
          {"scale", files.canvas.scale},
          {"width", width_of(files.hrls_windows.data)},
          {"height", height_of(files.hrls_windows.data)},
          {"lrhs_sampling", sampling_name(files)},
          {"tiles", tiling.count()}};
}

void show_plan(const FuseArguments& arguments, const FuseFiles& files, const Device& device) {
  const FuserOptions options = fuser_options(arguments, files, device.info());
  const FusePlan plan = plan_fusion(files.model, uint32_t(height_of(files.canvas.lrhs)),
                                    uint32_t(width_of(files.canvas.lrhs)), device.info(), options);
  const Tiling& tiling = plan.tiling;
  if (arguments.json) {
    Json json = facts(files, device.info(), options.storage, tiling);
    json["tile_width"] = tiling.tile.width, json["tile_height"] = tiling.tile.height;
    json["halo"] = tiling.halo;
    json["gflop"] = plan.flop * 1e-9;
    json["peak_bytes"] = plan.peak_bytes();
    json["activation_bytes"] = plan.activation_bytes;
    json["unaliased_bytes"] = plan.unaliased_bytes;
    json["hrls_layers"] = files.model.architecture().hrls_layers;
    fmt::print("{}\n", json.dump(2));
    return;
  }
  fmt::print("{}\ndevice {} ({})\n", describe(files), device.info().name, precision_name(options.storage));
  fmt::print("{} tile(s) of {} x {} LRHS pixels, halo {}; {:.3f} GFLOP, {:.1f} % of it for halos\n",
             tiling.count(), tiling.tile.width, tiling.tile.height, tiling.halo, plan.flop * 1e-9,
             100 - 100 / tiling.overhead());
  fmt::print(
      "memory {:.1f} MiB: weights {:.1f}, activations {:.1f} ({:.1f} without aliasing), frame {:.1f}\n",
      double(plan.peak_bytes()) / kMebibyte, double(plan.constant_bytes) / kMebibyte,
      double(plan.activation_bytes) / kMebibyte, double(plan.unaliased_bytes) / kMebibyte,
      double(plan.frame_bytes) / kMebibyte);
}

QualityTable measure_all(const FuseImages& images, const Comparison& comparison, const Image& fused) {
  return {{"fused", measure(fused, *images.reference)},
          {"bicubic_lrhs", measure(comparison.bicubic, *images.reference)},
          {"hrls", measure(comparison.hrls, *images.reference)}};
}

void print_json(const FuseFiles& files, const DeviceInfo& device, const FuseResult& result,
                const QualityTable& quality, const Console& console, double total_ms) {
  Json json = facts(files, device, result.storage, result.tiling);
  json["device_ms"] = result.report.device_ms;
  json["total_ms"] = total_ms;
  json["peak_bytes"] = result.allocated_bytes;
  json["metrics"] = to_json(quality);
  json["warnings"] = to_json(console.warnings());
  if (!result.report.passes.empty()) json["layers"] = to_json(result.report.passes);
  fmt::print("{}\n", json.dump(2));
}

}  // namespace

void run_fuse(const FuseArguments& arguments) {
  const Stopwatch watch;
  Console console(!arguments.quiet && !arguments.json);
  if (!arguments.dry_run) check_outputs(arguments);
  FuseFiles files = open_files(arguments);
  if (arguments.dry_run) return show_plan(arguments, files, *Device::create({.selector = arguments.device}));
  console.note(describe(files));
  const FuseImages images = load_images(files, console);
  check_interrupted();

  const auto device = Device::create({.selector = arguments.device});
  WrittenFiles written;
  const FuseResult result = run_frame(arguments, files, images, *device, console, written);
  std::optional<Comparison> comparison;
  if (images.reference || !arguments.before_after.empty()) comparison = make_comparison(files, images);
  write_outputs(arguments, files, images, comparison, result, console, written);
  written.keep();

  const QualityTable quality =
      images.reference ? measure_all(images, *comparison, result.fused) : QualityTable{};
  if (arguments.json) return print_json(files, device->info(), result, quality, console, watch.ms());
  if (!result.report.passes.empty()) fmt::print("{}", profile_text(result.report));
  if (!quality.empty()) fmt::print("{}", table(quality));
  console.note(fmt::format("wrote {}: {:.0f} ms on the device, {:.0f} ms in all, {:.0f} MiB of its memory",
                           arguments.output, result.report.device_ms, watch.ms(),
                           double(result.allocated_bytes) / kMebibyte));
}

}  // namespace raymeld::cli
