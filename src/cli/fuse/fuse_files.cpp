#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <climits>
#include <cmath>

#include "cli/common/inputs.h"
#include "cli/common/models.h"
#include "cli/fuse/fuse.h"
#include "fusion/exposure.h"
#include "io/exr_window.h"
#include "networks/network.h"
#include "numbers.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::array<int, 3> kScales = {2, 4, 8};

// Throws Error unless a model does what is asked for.
void check_task(const FuseArguments& arguments, const Model& model) {
  const uint32_t scale = model.architecture().scale;
  if (arguments.scale != 0 && arguments.scale != int(scale))
    throw Error("model {} has a scale of {}, and --scale is {}", model.name(), scale, arguments.scale);
  const Task task = task_of(model.architecture());
  if (task == arguments.task()) return;
  switch (task) {
    case Task::kFuse:
      throw Error("model {} fuses two renders: raymeld fuse takes it, with --lrhs and --hrls", model.name());
    case Task::kDenoise:
      throw Error("model {} denoises one render: raymeld denoise takes it, with --hrls alone", model.name());
    case Task::kUpscale:
      throw Error("model {} upscales one render: raymeld upscale takes it, with --lrhs alone", model.name());
  }
}

// Drops from LRHS's map what `choice` takes from other channels of HRLS, as LRHS's own would not match.
void drop_mapped(const LayerChoice& choice, LayerMap& map) {
  for (const auto& [layer, channels] : choice.overrides) {
    if (layer == "alpha") map.alpha.reset();
    if (layer != "color") map.layers.erase(layer);
  }
}

LayerMap map_lrhs(const FuseArguments& arguments, const ExrFile& lrhs) try {
  const bool has_own = !arguments.lrhs_map.empty();
  const LayerChoice choice = parse_layer_choice(has_own ? arguments.lrhs_map : arguments.map);
  LayerMap map = has_own ? map_layers(lrhs, choice) : map_color(lrhs, choice);
  if (!has_own) drop_mapped(choice, map);
  require_layers(map, kColor, lrhs.path().string());
  return map;
} catch (const Error& error) {
  throw Error("{}; --map-lrhs chooses the channels of LRHS", error.what());
}

Windows color_windows(const ExrFile& file, const LayerMap& map) {
  require_layers(map, kColor, file.path().string());
  return windows_of(file.header(file.channel(map.layers.at("color").terms[0][0]).part));
}

// Returns a window of LRHS in the pixels of its upscaled image. Throws Error if OpenEXR has no such window.
Imath::Box2i times(const ExrFile& lrhs, const Imath::Box2i& window, int scale) {
  const auto scaled = [&](int64_t at) {
    if (std::abs(at * scale) > INT_MAX / 2)
      throw Error("LRHS '{}' has a window from {},{} to {},{}, which has no place {} times as large",
                  lrhs.path().string(), window.min.x, window.min.y, window.max.x, window.max.y, scale);
    return int(at * scale);
  };
  const auto end = [&](int at) { return scaled(int64_t{at} + 1) - 1; };
  return {{scaled(window.min.x), scaled(window.min.y)}, {end(window.max.x), end(window.max.y)}};
}

std::string size_text(const Imath::Box2i& window) {
  return fmt::format("{} x {}", width_of(window), height_of(window));
}

std::string window_text(const Imath::Box2i& window) {
  return fmt::format("{},{},{},{}", window.min.x, window.min.y, width_of(window), height_of(window));
}

// Writes the data window's size, such as "512 x 512", and the display window's if it differs.
std::string size_text(const Windows& windows) {
  const std::string data = size_text(windows.data), display = size_text(windows.display);
  return data == display ? data : fmt::format("{} (display window {})", data, display);
}

std::string needed_sizes(const Windows& lrhs, std::span<const int> scales) {
  std::string text;
  for (int scale : scales) {
    text += fmt::format("{}{} x {} for x{}", text.empty() ? "" : ", ", int64_t{scale} * width_of(lrhs.data),
                        int64_t{scale} * height_of(lrhs.data), scale);
  }
  return text;
}

Canvas find_canvas(const ExrFile& lrhs, const Windows& lrhs_windows, const ExrFile& hrls,
                   const Windows& hrls_windows, std::span<const int> scales) {
  for (int scale : scales) {
    if (const auto canvas = fit(lrhs_windows, hrls_windows, scale)) return *canvas;
  }
  const auto fits_exchanged = [&](int scale) { return fit(hrls_windows, lrhs_windows, scale).has_value(); };
  if (std::ranges::any_of(scales, fits_exchanged)) {
    throw Error("LRHS '{}' is {} and HRLS '{}' is {}: they seem to be exchanged, as LRHS is the small render",
                lrhs.path().string(), size_text(lrhs_windows), hrls.path().string(), size_text(hrls_windows));
  }
  throw Error("the sizes do not fit: LRHS '{}' is {} and HRLS '{}' is {}; HRLS would have to be {}",
              lrhs.path().string(), size_text(lrhs_windows), hrls.path().string(), size_text(hrls_windows),
              needed_sizes(lrhs_windows, scales));
}

// Returns the phase of LRHS samples and its source. The phase is preliminary if the source is kDefault.
std::pair<float, PhaseSource> said_phase(const std::string& option, const ExrFile& lrhs, uint32_t scale) {
  const auto* mark = lrhs.header().findTypedAttribute<Imf::StringAttribute>("raymeldSampling");
  const std::string file = mark ? mark->value() : "";
  for (const auto& [said, source] : {std::pair(option, PhaseSource::kOption), {file, PhaseSource::kFile}}) {
    if (said == "nearest" || said == "centered") return {lrhs_phase(said == "centered", scale), source};
  }
  return {lrhs_phase(true, scale), PhaseSource::kDefault};
}

// Returns how many samples a pixel of a file has: as an option says, or as Cycles writes into its file; 0 if
// neither does.
float known_spp(float option, const ExrFile& file, const LayerMap& map) {
  if (option > 0) return option;
  const std::string name = fmt::format("cycles.{}.samples", map.view_layer);
  const auto* text = file.header().findTypedAttribute<Imf::StringAttribute>(name);
  float spp = 0;
  if (text) std::from_chars(text->value().data(), text->value().data() + text->value().size(), spp);
  return std::isfinite(spp) && spp >= 1 ? spp : 0;
}

// Returns the guides that a file has. Throws Error if it has none, or one is not as large as HRLS.
LayerMap map_guides(const ExrFile& file, const LayerChoice& choice, const ExrFile& hrls,
                    const Imath::Box2i& hrls_window) {
  LayerMap map = map_color(file, choice);
  std::erase_if(map.layers, [](const auto& layer) { return !is_guide(layer.first); });
  if (map.layers.empty())
    throw Error("the guides '{}' have neither albedo nor normal; the file has {}", file.path().string(),
                map.has);
  for (const auto& [layer, source] : map.layers) {
    const Imath::Box2i window = file.header(file.channel(source.terms[0][0]).part).dataWindow();
    if (window.size() != hrls_window.size())
      throw Error("the {} of the guides '{}' is {}, and HRLS '{}' is {}: the sizes must be equal", layer,
                  file.path().string(), size_text(window), hrls.path().string(), size_text(hrls_window));
  }
  return map;
}

// Throws Error unless HRLS has motion vectors, and a depth that was named, as large as the color. Another
// depth of another size is not taken.
void check_motion(const ExrFile& hrls, const LayerChoice& choice, const Imath::Box2i& color, LayerMap& map) {
  if (!map.motion)
    throw Error("{}\n  --map motion=PREFIX names them, and --still says that nothing moves",
                no_motion_text(map, hrls.path().string()));
  const auto window_of = [&](const std::string& channel) {
    return hrls.header(hrls.channel(channel).part).dataWindow();
  };
  const auto check_window = [&](const char* layer, const std::string& channel) {
    if (const Imath::Box2i window = window_of(channel); window != color)
      throw Error("HRLS '{}': the {} has another data window than the color, {} instead of {}",
                  hrls.path().string(), layer, window_text(window), window_text(color));
  };
  for (const std::string& name : map.motion->channels) check_window("motion", name);
  if (choice.overrides.contains("depth")) check_window("depth", *map.depth);
  if (map.depth && window_of(*map.depth) != color) map.depth.reset();
}

// Returns the motion of the canvas with its depth, (4, H, W).
Image motion_of(FuseFiles& files, const FuseArguments& arguments) {
  if (arguments.still) return Image(width_of(files.canvas.hrls), height_of(files.canvas.hrls), 4);
  return seen_through(load_motion(files.hrls, files.hrls_map), files.hrls_windows.data, files.canvas.hrls);
}

// Returns the layers that neither HRLS nor the guides have.
ConstantLayers absent_layers(const LayerMap& hrls, const LayerMap& guides, const Architecture& model) {
  ConstantLayers absent;
  for (const std::string& layer : model.optional_layers) {
    if (!hrls.layers.contains(layer) && !guides.layers.contains(layer)) absent[layer] = {};
  }
  return absent;
}

// Splits layers into those that are read from HRLS and those that are read from the guides.
std::pair<std::vector<std::string>, std::vector<std::string>> split_layers(
    std::span<const std::string> layers, const LayerMap& guides) {
  std::pair<std::vector<std::string>, std::vector<std::string>> split;
  for (const std::string& layer : layers)
    (guides.layers.contains(layer) ? split.second : split.first).push_back(layer);
  return split;
}

// Names the image that the output is as large as.
std::string full_size_name(const FuseArguments& arguments, const ExrFile& hrls) {
  const char* what = arguments.task() == Task::kUpscale ? "the upscaled LRHS" : "HRLS";
  return fmt::format("{} '{}'", what, hrls.path().string());
}

// Throws Error unless the reference is as large as the output's data window.
void check_reference(const FuseArguments& arguments, const ExrFile& reference, const LayerMap& map,
                     const ExrFile& hrls, const Imath::Box2i& data) {
  const Imath::Box2i window = color_windows(reference, map).data;
  if (window.size() == data.size()) return;
  throw Error("the reference '{}' is {}, and {} is {}: the sizes must be equal", reference.path().string(),
              size_text(window), full_size_name(arguments, hrls), size_text(data));
}

// Returns the window to write: the data window, or the part of it that --window asks for. Throws Error.
Imath::Box2i find_window(const FuseArguments& arguments, const ExrFile& hrls, const Imath::Box2i& data) {
  if (!arguments.window) return data;
  const Imath::Box2i& window = *arguments.window;
  if (data.intersects(window.min) && data.intersects(window.max)) return window;
  throw Error("--window {} is not within the data window {} of {}", window_text(window), window_text(data),
              full_size_name(arguments, hrls));
}

// Returns the part of `frame` that is computed for a window. The variance of companions is found within it.
Canvas find_canvas(const Canvas& frame, const Imath::Box2i& window, const Architecture& model) {
  const bool reads_variance = std::ranges::count(model.hrls_layers, "variance") > 0;
  return part_of(frame, window, int(receptive_halo(model, reads_variance)), int(model.grid()));
}

// Returns the number of pixels of the canvas that LRHS has no data for.
uint64_t pixels_outside(const Windows& lrhs, const Imath::Box2i& canvas) {
  const auto area = [](const Imath::Box2i& window) {
    return uint64_t(std::max(width_of(window), 0)) * uint64_t(std::max(height_of(window), 0));
  };
  const Imath::V2i first(std::max(lrhs.data.min.x, canvas.min.x), std::max(lrhs.data.min.y, canvas.min.y));
  const Imath::V2i last(std::min(lrhs.data.max.x, canvas.max.x), std::min(lrhs.data.max.y, canvas.max.y));
  return area(canvas) - area({first, last});
}

// Returns the pixels of LRHS's file that the canvas reads.
Imath::Box2i read_from_lrhs(const FuseFiles& files) {
  const Imath::Box2i& window = files.canvas.lrhs;
  const auto down = [factor = files.upsampling()](Imath::V2i at) {
    return Imath::V2i(divide_down(at.x, factor), divide_down(at.y, factor));
  };
  return {down(window.min), down(window.max)};
}

void check_passed_channels(const FuseFiles& files, const FuseArguments& arguments) {
  for (const std::string& name : passed_channels(files, arguments)) {
    const ExrChannel& channel = files.hrls.channel(name);
    const Imath::Box2i window = files.hrls.header(channel.part).dataWindow();
    if (window != files.hrls_windows.data) {
      throw Error(
          "HRLS '{}': channel '{}' has another data window than the colour, {} instead of {}, and "
          "cannot be copied",
          files.hrls.path().string(), name, size_text(window), size_text(files.hrls_windows.data));
    }
    if (can_be_cropped(channel, files.window)) continue;
    throw Error(
        "HRLS '{}': channel '{}' has one sample for {} x {} pixels; --window {} must start at and span "
        "multiples of these, as the channel is copied",
        files.hrls.path().string(), name, channel.x_sampling, channel.y_sampling, window_text(files.window));
  }
}

void check_written(const FuseArguments& arguments, const Model& model) {
  std::vector<fs::path> inputs = arguments.inputs(), outputs = arguments.outputs();
  inputs.push_back(model.file());
  if (!arguments.dump.empty()) {
    // A folder that exists is checked through the name of a file inside it.
    std::error_code error;
    const fs::path dump = arguments.dump_folder();
    const bool is_folder = fs::is_directory(dump, error);
    if (!is_folder && fs::exists(dump, error)) {
      throw Error("--dump '{}' must be a folder, and there is a file of that name", arguments.dump);
    }
    outputs.push_back(is_folder ? arguments.last_dumped() : dump);
  }
  check_outputs(outputs, inputs);
}

}  // namespace

FuseFiles open_files(const FuseArguments& arguments, LastModel& models) {
  const Task task = arguments.task();
  ExrFile lrhs(task == Task::kDenoise ? arguments.hrls : arguments.lrhs),
      hrls(task == Task::kUpscale ? arguments.lrhs : arguments.hrls);
  const LayerChoice choice = parse_layer_choice(arguments.map);
  LayerMap hrls_map = map_layers(hrls, choice);
  LayerMap lrhs_map = task == Task::kFuse ? map_lrhs(arguments, lrhs) : hrls_map;
  const Windows lrhs_windows = color_windows(lrhs, lrhs_map);
  Windows hrls_windows = color_windows(hrls, hrls_map);
  const auto canvas_of = [&](std::span<const int> scales) {
    return find_canvas(lrhs, lrhs_windows, hrls, hrls_windows, scales);
  };
  const auto scale = [&] {
    if (task == Task::kUpscale) return arguments.scale != 0 ? arguments.scale : kUpscaledBy;
    return task == Task::kDenoise ? 1 : canvas_of(kScales).scale;
  };
  auto model =
      models.load(arguments.model.empty() ? default_model(task, scale()) : find_model(arguments.model, task));
  check_task(arguments, *model);
  const Architecture& architecture = model->architecture();
  if (task == Task::kUpscale) {
    const int factor = int(architecture.scale);
    hrls_windows = {times(lrhs, lrhs_windows.data, factor), times(lrhs, lrhs_windows.display, factor)};
  }
  const Canvas frame = canvas_of(pair_scales(int(architecture.scale)));
  const Imath::Box2i window = find_window(arguments, hrls, hrls_windows.data);
  const Canvas canvas =
      find_canvas(upsampled(frame, frame.scale / int(architecture.scale)), window, architecture);
  std::optional<ExrFile> guides;
  LayerMap guides_map;
  if (!arguments.guides.empty()) {
    guides.emplace(arguments.guides);
    guides_map = map_guides(*guides, choice, hrls, hrls_windows.data);
  }
  const ConstantLayers absent = absent_layers(hrls_map, guides_map, architecture);
  const bool computes_variance =
      arguments.temporal && std::ranges::count(architecture.hrls_layers, "variance") > 0;
  require_layers(hrls_map,
                 split_layers(image_layers(architecture, absent, computes_variance), guides_map).first,
                 hrls.path().string());
  if ((arguments.temporal && !arguments.still) || choice.motion_factors)
    check_motion(hrls, choice, hrls_windows.data, hrls_map);
  if (arguments.layers) {
    require_layers(lrhs_map, kSplitLight, lrhs.path().string());
    require_layers(hrls_map, kSplitLight, hrls.path().string());
  }
  std::optional<ExrFile> reference;
  LayerMap reference_map;
  if (!arguments.reference.empty()) {
    reference.emplace(arguments.reference);
    reference_map = map_color(*reference, choice);
    check_reference(arguments, *reference, reference_map, hrls, hrls_windows.data);
  }
  const auto [phase, phase_source] = said_phase(arguments.sampling, lrhs, uint32_t(frame.scale));
  const SampleCounts samples{known_spp(arguments.samples.lrhs, lrhs, lrhs_map),
                             known_spp(arguments.samples.hrls, hrls, hrls_map)};
  FuseFiles files{std::move(lrhs),
                  std::move(hrls),
                  std::move(lrhs_map),
                  std::move(hrls_map),
                  lrhs_windows,
                  hrls_windows,
                  std::move(model),
                  frame,
                  canvas,
                  window,
                  absent,
                  phase,
                  phase_source,
                  samples,
                  {},
                  std::move(reference),
                  std::move(reference_map),
                  std::move(guides),
                  std::move(guides_map),
                  computes_variance};
  check_passed_channels(files, arguments);
  return files;
}

Image for_canvas(const FuseFiles& files, Image lrhs, const Imath::Box2i& from) {
  const int factor = files.upsampling();
  if (factor == 1) return seen_through(std::move(lrhs), from, files.canvas.lrhs);
  lrhs = seen_through(std::move(lrhs), from, files.frame.lrhs);
  const float scale = float(files.canvas.scale);
  lrhs = upsample_bilinear(lrhs, factor, (files.phase - files.model_phase()) / scale);
  return seen_through(std::move(lrhs), upsampled(files.frame, factor).lrhs, files.canvas.lrhs);
}

void sanitize_lrhs(Image& lrhs, const FuseFiles& files, Console& console) {
  if (!files.reads_lrhs()) {
    sanitize(lrhs);  // a warning of HRLS counts these values
  } else {
    sanitize_input(lrhs, "LRHS", files.lrhs.path(), console);
  }
}

Image load_lrhs(FuseFiles& files, Console& console) {
  Image lrhs = load_layers(files.lrhs, files.lrhs_map, kColor);
  sanitize_input(lrhs, "LRHS", files.lrhs.path(), console);
  if (const uint64_t outside = pixels_outside(files.lrhs_windows, read_from_lrhs(files))) {
    console.warn(
        fmt::format("LRHS '{}': {} pixels that HRLS needs lie outside its data window, whose edge is "
                    "repeated there",
                    files.lrhs.path().string(), outside),
        outside);
  }
  return seen_through(std::move(lrhs), files.lrhs_windows.data, files.frame.lrhs);
}

Image load_hrls(FuseFiles& files, std::span<const std::string> layers, Console& console) {
  const auto [own, guided] = split_layers(layers, files.guides_map);
  Image read = load_layers(files.hrls, files.hrls_map, own);
  sanitize_input(read, "HRLS", files.hrls.path(), console);
  if (guided.empty()) return read;
  Image guides = load_layers(*files.guides, files.guides_map, guided);
  sanitize_input(guides, "guides", files.guides->path(), console);
  Image all(read.width, read.height, 3 * int(layers.size()));
  int next = 0, next_guide = 0;
  for (size_t i = 0; i < layers.size(); ++i) {
    const bool is_guided = files.guides_map.layers.contains(layers[i]);
    const float* from = is_guided ? guides.plane(3 * next_guide++) : read.plane(3 * next++);
    std::copy_n(from, 3 * all.plane_size(), all.plane(3 * int(i)));
  }
  return all;
}

ColorPair load_colors(const FuseArguments& arguments, FuseFiles& files, Console& console) {
  std::vector<std::string> layers = files.layers_without(files.absent_layers);
  std::erase_if(layers, [](const std::string& layer) { return layer != "color" && !is_guide(layer); });
  Image lrhs, hrls;
  if (files.reads_hrls()) {
    hrls = load_hrls(files, layers, console);
    hrls = seen_through(std::move(hrls), files.hrls_windows.data, files.frame.hrls);
  }
  lrhs = files.reads_lrhs() ? load_lrhs(files, console) : first_channels(hrls, 3);
  examine(arguments, files, lrhs, hrls, layers, console);
  return {std::move(lrhs), std::move(hrls)};
}

float exposure_for(const FuseArguments& arguments, const Model& model, const Image& lrhs) {
  if (arguments.input_exposure != 0) return arguments.input_exposure;
  return exposure_of(lrhs.data.data(), lrhs.plane_size(), model.architecture().exposure_key);
}

std::unique_ptr<FuseFrame> open_frame(const FuseArguments& arguments, Console console, LastModel& models) {
  const Stopwatch watch;
  FuseFiles files = open_files(arguments, models);
  check_written(arguments, *files.model);
  std::unique_ptr<FuseFrame> frame(
      new FuseFrame{arguments, std::move(console), std::move(files), {}, {}, {}});
  frame->phases.push_back({"open", watch.ms()});
  return frame;
}

void load_frame(FuseFrame& frame) {
  const PhaseTimer timer(frame, "read");
  FuseFiles& files = frame.files;
  FuseImages& images = frame.images;
  if (files.reads_lrhs()) images.lrhs = load_lrhs(files, frame.console);
  const Architecture& model = files.model->architecture();
  images.constants = files.absent_layers;
  if (files.reads_hrls()) {
    images.hrls = load_hrls(files, files.layers_without(images.constants), frame.console);
    // A history holds the same layers from frame to frame.
    if (!frame.arguments.temporal) take_constant_layers(model, images.hrls, images.constants);
    images.hrls = seen_through(std::move(images.hrls), files.hrls_windows.data, files.frame.hrls);
  }
  if (!files.reads_lrhs()) images.lrhs = first_channels(images.hrls, 3);
  examine(frame.arguments, files, images.lrhs, images.hrls, files.layers_without(images.constants),
          frame.console);
  images.exposure = exposure_for(frame.arguments, *files.model, images.lrhs);
  const bool is_written = !frame.time.is_lead_in;
  if (is_written && frame.arguments.compares()) {
    // Cubic interpolation reads two LRHS pixels in each direction.
    const Canvas part = part_of(files.frame, files.window, 2);
    const Image lrhs = seen_through(images.lrhs, files.frame.lrhs, part.lrhs);
    if (files.reads_lrhs())
      images.shown.bicubic =
          seen_through(upsample_bicubic(lrhs, part.scale, files.phase), part.hrls, files.window);
    if (files.reads_hrls())
      images.shown.hrls = seen_through(first_channels(images.hrls, 3), files.frame.hrls, files.window);
  }
  images.lrhs = for_canvas(files, std::move(images.lrhs), files.frame.lrhs);
  if (files.reads_hrls())
    images.hrls = seen_through(std::move(images.hrls), files.frame.hrls, files.canvas.hrls);
  if (frame.arguments.temporal) images.motion = motion_of(files, frame.arguments);
  if (is_written && files.reference) {
    images.reference = load_layers(*files.reference, files.reference_map, kColor);
    sanitize_input(*images.reference, "reference", files.reference->path(), frame.console);
    images.reference = seen_through(std::move(*images.reference), files.hrls_windows.data, files.window);
  }
  const bool keeps = frame.arguments.keep_layers;
  for (const std::string& name : passed_channels(files, frame.arguments)) {
    if (!is_written && name != files.hrls_map.alpha) continue;
    ExrRawChannel channel = files.hrls.read_raw(name);
    if (name == files.hrls_map.alpha && load_alpha(frame, channel)) continue;
    images.passed.push_back(cropped(std::move(channel), files.window));
    sanitize_passed(images.passed.back(), !keeps, "HRLS", files.hrls.path(), frame.console);
  }
  if (!files.reads_hrls()) load_lrhs_alpha(frame);
  if (frame.arguments.layers) load_light(frame);
}

}  // namespace raymeld::cli
