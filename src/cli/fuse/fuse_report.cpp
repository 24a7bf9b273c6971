// Writes the lines about a frame for stderr, and its tables for stdout.
#include "cli/fuse/fuse_report.h"

#include <fmt/ranges.h>

#include "cli/fuse/layer_costs.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

std::string size_text(const Imath::Box2i& window) {
  return fmt::format("{} x {}", width_of(window), height_of(window));
}

// Returns an empty text if the whole data window is written.
std::string window_text(const FuseFiles& files) {
  const Imath::Box2i& window = files.window;
  if (window == files.hrls_windows.data) return "";
  return fmt::format(", window {} at {},{}", size_text(window), window.min.x, window.min.y);
}

std::string row(const std::string& name, double time_ms, double flop, double bytes) {
  return fmt::format("{:<30} {:>12.3f} {:>10.2f} {:>10.2f}\n", name, time_ms, giga_per_second(flop, time_ms),
                     giga_per_second(bytes, time_ms));
}

std::string profile_text(const FuseFrame& frame) {
  const FuseReport& report = frame.result.report;
  std::string text = fmt::format("{:<30} {:>12}\n", "phase", "ms");
  for (const Phase& phase : frame.phases)
    text += fmt::format("{:<30} {:>12.3f}\n", phase.name, phase.time_ms);
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

// Adds up the costs of absent layers; all of them together have a measured cost. Empty if no cost is known.
std::string cost_text(const ConstantLayers& absent) {
  double db = 0;
  size_t known = 0;
  for (const LayerCost& cost : kLayerCosts) {
    if (!absent.contains(std::string(cost.layer))) continue;
    db += cost.db;
    ++known;
  }
  if (known == 0) return "";
  if (known == kLayerCosts.size()) db = kAllLayersCostDb;
  return db < 0.1 ? ", which costs less than 0.1 dB" : fmt::format(", which costs about {:.1f} dB", db);
}

// Names the layers that the model takes and HRLS lacks.
std::string absent_text(const ConstantLayers& absent) {
  std::vector<std::string> names;
  for (const auto& [layer, zeros] : absent) names.push_back(layer);
  return fmt::format("no {}{}", fmt::join(names, ", "), cost_text(absent));
}

// Says which view layer is read if a file has several.
void add_view_layers(const char* role, const LayerMap& map, std::vector<std::string>& found) {
  if (map.others.empty()) return;
  found.push_back(fmt::format("{} has several view layers, and '{}{}{}' is read; others are {}", role,
                              map.view_layer, map.view.empty() ? "" : ".", map.view,
                              fmt::join(map.others, " or ")));
}

// Says how LRHS was sampled and how that is known.
std::string sampling_text(const FuseFiles& files) {
  const std::string what = files.phase > 0
                               ? "an ordinary small render"
                               : fmt::format("one of {0} x {0} pixels of a full render", files.frame.scale);
  const auto why = [&] {
    switch (files.phase_source) {
      case PhaseSource::kOption:
        return "as --lrhs-sampling says";
      case PhaseSource::kFile:
        return "as its file says";
      case PhaseSource::kPair:
        return "as the pixels show";
      case PhaseSource::kDefault:
        return files.reads_hrls() ? "as the pixels do not show another kind"
                                  : "as neither its file nor --lrhs-sampling says otherwise";
    }
    return "";
  };
  return fmt::format("LRHS is {}, {}", what, why());
}

// Says how many samples the model takes the renders to have.
std::string samples_text(const FuseFiles& files) {
  const auto [lrhs, hrls] = files.model_samples().known(uint32_t(files.canvas.scale));
  if (!files.reads_lrhs())
    return fmt::format("{:g} samples a pixel{}", hrls,
                       files.samples.hrls > 0 ? "" : ", as the file does not say (--hrls-spp)");
  const int upsampled = files.upsampling() * files.upsampling();
  const bool said = files.samples.lrhs > 0 && files.samples.hrls > 0;
  return fmt::format("{:g} and {:g} samples a pixel{}", lrhs * float(upsampled), hrls,
                     said ? "" : ", as the files do not say (--lrhs-spp, --hrls-spp)");
}

}  // namespace

const char* sampling_name(const FuseFiles& files) { return files.phase == 0 ? "nearest" : "centered"; }

const char* sampling_source(const FuseFiles& files) {
  switch (files.phase_source) {
    case PhaseSource::kOption:
      return "option";
    case PhaseSource::kFile:
      return "file";
    case PhaseSource::kPair:
      return "pair";
    case PhaseSource::kDefault:
      return "default";
  }
  return "";
}

double giga_per_second(double count, double time_ms) { return time_ms > 0 ? count / time_ms * 1e-6 : 0; }

ConstantLayers found_constants(const FuseFrame& frame) {
  ConstantLayers found = frame.images.constants;
  for (const auto& [layer, zeros] : frame.files.absent_layers) found.erase(layer);
  return found;
}

std::vector<std::string> findings(const FuseFiles& files) {
  std::vector<std::string> found;
  if (files.reads_lrhs()) found.push_back(sampling_text(files));
  if (files.frame.lrhs == files.lrhs_windows.data &&
      !starts_agree(files.lrhs_windows, files.hrls_windows, files.frame.scale))
    found.push_back("the data windows start at different places and are taken for the same view");
  if (files.model->architecture().knows_spp) found.push_back(samples_text(files));
  if (files.reads_lrhs()) add_view_layers("LRHS", files.lrhs_map, found);
  if (files.reads_hrls()) add_view_layers("HRLS", files.hrls_map, found);
  if (!files.absent_layers.empty()) found.push_back(absent_text(files.absent_layers));
  if (files.reads_lrhs() && !files.model->architecture().trained_on(files.model_phase() > 0))
    found.push_back(fmt::format("{} was not trained on {} LRHS", files.model->name(),
                                files.model_phase() > 0 ? "centered" : "nearest"));
  return found;
}

std::vector<std::string> findings(const FuseFrame& frame) {
  std::vector<std::string> found = findings(frame.files);
  for (const auto& [layer, values] : found_constants(frame))
    found.push_back(fmt::format("{} is {} everywhere", layer, fmt::join(values, ", ")));
  if (frame.images.exposure != 1)
    found.push_back(fmt::format("input exposure {:.4g}", frame.images.exposure));
  return found;
}

std::string read_text(const FuseArguments& names, const FuseFiles& files) {
  if (!files.reads_lrhs())
    return fmt::format("read {}, {}{}", names.hrls, size_text(files.hrls_windows.data), window_text(files));
  if (!files.reads_hrls())
    return fmt::format("read {}, {}{}: scale {}", names.lrhs, size_text(files.lrhs_windows.data),
                       window_text(files), files.frame.scale);
  return fmt::format("read {}, {}, and {}, {}{}: scale {}", names.lrhs, size_text(files.lrhs_windows.data),
                     names.hrls, size_text(files.hrls_windows.data), window_text(files), files.frame.scale);
}

std::string device_text(const FuseFiles& files, const DeviceInfo& device, Storage storage) {
  return fmt::format("{} on {} with {} in {}", words_of(task_of(files.model->architecture())).doing,
                     device.name, files.model->name(), precision_name(storage));
}

std::string found_text(const std::vector<std::string>& findings) {
  return fmt::format("found: {}", fmt::join(findings, "; "));
}

std::vector<std::string> opening_lines(const FuseArguments& names, const FuseFrame& frame,
                                       const DeviceInfo& device) {
  const Storage storage = storage_for(names.precision, device, *frame.files.model);
  return {read_text(names, frame.files), device_text(frame.files, device, storage),
          found_text(findings(frame))};
}

std::string channels_text(const FuseArguments& names, const FuseFiles& files) {
  const std::string takes = fmt::format("model {} takes ", files.model->name());
  if (!files.reads_hrls())
    return fmt::format("LRHS {}: {}{}color", names.lrhs, layer_map_text(files.lrhs_map), takes);
  const std::string guides =
      files.guides ? fmt::format("guides {}: {}", names.guides, layer_map_text(files.guides_map)) : "";
  const std::string lrhs = files.reads_lrhs()
                               ? fmt::format("LRHS {}: color from {}\n", names.lrhs,
                                             fmt::join(files.lrhs_map.layers.at("color").terms[0], ", "))
                               : "";
  return fmt::format("{}HRLS {}: {}{}{}{}", lrhs, names.hrls, layer_map_text(files.hrls_map), guides, takes,
                     fmt::join(files.model->architecture().hrls_layers, ", "));
}

std::string took_text(const FuseFrame& frame, double total_ms) {
  const FuseReport& report = frame.result.report;
  std::string text = fmt::format(
      "{:.0f} ms on the device, {:.0f} ms in total, {:.0f} MiB of device memory; input exposure {:.4g}",
      report.device_ms, total_ms, double(frame.result.allocated_bytes) / kMebibyte, report.exposure);
  if (report.skipped_share > 0) {
    text += fmt::format("; {:.0f} % of the frame is copied from the last one, as nothing changed there",
                        100 * report.skipped_share);
  }
  return text;
}

std::string written_text(const FuseArguments& arguments) {
  std::vector<std::string> names;
  for (const std::filesystem::path& path : arguments.outputs()) names.push_back(path.string());
  if (!arguments.dump.empty()) names.push_back(arguments.dump);
  return fmt::format("{}", fmt::join(names, ", "));
}

std::string frame_text(const FuseFrame& frame, const QualityTable& quality) {
  return (frame.result.report.layers.empty() ? "" : profile_text(frame)) +
         (quality.empty() ? "" : table(quality));
}

}  // namespace raymeld::cli
