// Shows how a frame would be fused, for --dry-run.
#include "cli/fuse/fuse_report.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

struct Plan {
  float exposure = 0;
  int runs = 1;  // the network's runs, of which `fusion` is one
  FuserOptions options;
  FusePlan fusion;
};

Plan make_plan(const FuseArguments& arguments, FuseFiles& files, const Device& device, Console& console) {
  const ColorPair colors = load_colors(arguments, files, console);
  const float exposure = exposure_for(arguments, *files.model, colors.lrhs);
  const FuserOptions options = options_of(arguments, files, device, files.absent_layers);
  return {exposure, count_runs(files, arguments), options,
          plan_fusion(*files.model, uint32_t(height_of(files.canvas.lrhs)),
                      uint32_t(width_of(files.canvas.lrhs)), device.info(), options)};
}

}  // namespace

nlohmann::ordered_json plan_json(const FuseArguments& arguments, FuseFiles& files, const Device& device,
                                 Console& console) {
  const Plan plan = make_plan(arguments, files, device, console);
  const Tiling& tiling = plan.fusion.tiling;
  const Graph& graph = plan.fusion.graph;
  auto json = facts(files, device.info(), plan.options.storage, tiling, plan.exposure);
  json["tile_width"] = tiling.tile.width, json["tile_height"] = tiling.tile.height;
  json["halo"] = tiling.halo;
  json["runs"] = plan.runs;
  json["gflop"] = plan.runs * plan.fusion.flop * 1e-9;
  json["peak_bytes"] = plan.fusion.peak_bytes();
  json["activation_bytes"] = graph.activation_bytes();
  json["unaliased_bytes"] = graph.unaliased_bytes();
  if (files.reads_lrhs()) json["layers"]["lrhs"] = to_json(files.lrhs_map);
  if (files.reads_hrls()) json["layers"]["hrls"] = to_json(files.hrls_map);
  if (files.guides) json["layers"]["guides"] = to_json(files.guides_map);
  if (files.reads_hrls()) json["hrls_layers"] = files.model->architecture().hrls_layers;
  return json;
}

std::string plan_text(const FuseArguments& arguments, FuseFiles& files, const Device& device,
                      Console& console) {
  const Plan plan = make_plan(arguments, files, device, console);
  const Tiling& tiling = plan.fusion.tiling;
  const Graph& graph = plan.fusion.graph;
  return fmt::format("{}\n{}\n{}\n{}\ninput exposure {:.4g}\n", read_text(arguments, files),
                     device_text(files, device.info(), plan.options.storage), found_text(findings(files)),
                     channels_text(arguments, files), plan.exposure) +
         fmt::format("{} tile(s) of {} x {} {}, halo {}; {:.3f} GFLOP, {:.1f} % of it for halos\n",
                     tiling.count(), tiling.tile.width, tiling.tile.height, files.pixels(), tiling.halo,
                     plan.runs * plan.fusion.flop * 1e-9, 100 - 100 / tiling.overhead()) +
         (plan.runs == 1 ? ""
                         : fmt::format("{} runs, for the color and what is fused beside it\n", plan.runs)) +
         fmt::format(
             "memory {:.1f} MiB: weights {:.1f}, activations {:.1f} ({:.1f} without aliasing), frame "
             "{:.1f}\n",
             double(plan.fusion.peak_bytes()) / kMebibyte, double(graph.constant_bytes()) / kMebibyte,
             double(graph.activation_bytes()) / kMebibyte, double(graph.unaliased_bytes()) / kMebibyte,
             double(plan.fusion.frame_bytes) / kMebibyte);
}

}  // namespace raymeld::cli
