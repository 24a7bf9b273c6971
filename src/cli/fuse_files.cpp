#include <OpenEXR/ImfStringAttribute.h>

#include <array>

#include "cli/fuse.h"
#include "cli/models.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::array<int, 3> kScales = {2, 4, 8};
const std::vector<std::string> kColor = {"color"};

LayerChoice lrhs_choice(const FuseArguments& arguments) {
  if (!arguments.lrhs_map.empty()) return parse_layer_choice(arguments.lrhs_map);
  LayerChoice choice = parse_layer_choice(arguments.map);
  std::erase_if(choice.overrides, [](const auto& item) { return item.first != "color"; });
  return choice;
}

Windows color_windows(const ExrFile& file, const LayerMap& map) {
  require_layers(map, kColor, file.path().string());
  return windows_of(file.header(file.channel(map.layers.at("color").terms[0][0]).part));
}

std::string size_text(const Imath::Box2i& window) {
  return fmt::format("{} x {}", width_of(window), height_of(window));
}

// Like "512 x 512", with the display window where that has another size.
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
  throw Error("the sizes do not fit: LRHS '{}' is {} and HRLS '{}' is {}; HRLS would have to be {}",
              lrhs.path().string(), size_text(lrhs_windows), hrls.path().string(), size_text(hrls_windows),
              needed_sizes(lrhs_windows, scales));
}

// Where nobody says it, LRHS is read as in training: weights made for nearest samples lose about 2 dB on a
// real low-resolution render when their base is shifted by its true phase.
float find_phase(std::string sampling, const ExrFile& lrhs, const Architecture& model) {
  const auto* said = lrhs.header().findTypedAttribute<Imf::StringAttribute>("raymeldSampling");
  if (sampling == "auto" && said) sampling = said->value();
  const bool centered = sampling == "centered" || (sampling != "nearest" && model.lrhs_centered);
  return lrhs_phase(centered, model.scale);
}

// Throws Error unless the reference is as large as what it is to be compared with.
ExrFile open_reference(const fs::path& path, const ExrFile& hrls, const Imath::Box2i& hrls_window) {
  ExrFile reference(path);
  const Imath::Box2i window = color_windows(reference, map_layers(reference)).data;
  if (window.size() != hrls_window.size()) {
    throw Error("the reference '{}' is {}, and HRLS '{}' is {}: the sizes must be equal", path.string(),
                size_text(window), hrls.path().string(), size_text(hrls_window));
  }
  return reference;
}

void sanitize_input(Image& image, const char* role, const fs::path& path, Console& console) {
  const NonFinite counts = sanitize(image);
  const auto warn = [&](size_t count, const char* what, const char* instead) {
    if (count > 0)
      console.warn(
          fmt::format("{} '{}': {} values are {}; used as {}", role, path.string(), count, what, instead),
          count);
  };
  warn(counts.nan, "NaN", "0");
  warn(counts.inf, "infinite", "+-65504");
}

}  // namespace

std::vector<fs::path> FuseArguments::inputs() const {
  std::vector<fs::path> paths = {lrhs, hrls};
  if (!reference.empty()) paths.push_back(reference);
  return paths;
}

std::vector<fs::path> FuseArguments::outputs() const {
  std::vector<fs::path> paths;
  for (const std::string& path : {output, preview, before_after}) {
    if (!path.empty()) paths.push_back(path);
  }
  return paths;
}

fs::path FuseArguments::dump_folder() const {
  const fs::path folder = dump;
  return folder.has_filename() ? folder : folder.parent_path();
}

FuseFiles open_files(const FuseArguments& arguments) {
  ExrFile lrhs(arguments.lrhs), hrls(arguments.hrls);
  LayerMap lrhs_map = map_layers(lrhs, lrhs_choice(arguments));
  LayerMap hrls_map = map_layers(hrls, parse_layer_choice(arguments.map));
  const Windows lrhs_windows = color_windows(lrhs, lrhs_map), hrls_windows = color_windows(hrls, hrls_map);
  const auto canvas_of = [&](std::span<const int> scales) {
    return find_canvas(lrhs, lrhs_windows, hrls, hrls_windows, scales);
  };
  const fs::path model_file =
      arguments.model.empty() ? default_model(canvas_of(kScales).scale) : find_model(arguments.model);
  Model model(model_file);
  const std::array<int, 1> scale = {int(model.architecture().scale)};
  const Canvas canvas = canvas_of(scale);
  require_layers(hrls_map, model.architecture().hrls_layers, hrls.path().string());
  std::optional<ExrFile> reference;
  if (!arguments.reference.empty()) reference = open_reference(arguments.reference, hrls, hrls_windows.data);
  const float phase = find_phase(arguments.sampling, lrhs, model.architecture());
  return {std::move(lrhs), std::move(hrls),     std::move(lrhs_map), std::move(hrls_map),
          lrhs_windows,    hrls_windows,        std::move(model),    canvas,
          phase,           std::move(reference)};
}

FuseImages load_images(FuseFiles& files, Console& console) {
  FuseImages images;
  images.lrhs = load_layers(files.lrhs, files.lrhs_map, kColor);
  images.hrls = load_layers(files.hrls, files.hrls_map, files.model.architecture().hrls_layers);
  sanitize_input(images.lrhs, "LRHS", files.lrhs.path(), console);
  sanitize_input(images.hrls, "HRLS", files.hrls.path(), console);
  images.lrhs = seen_through(std::move(images.lrhs), files.lrhs_windows.data, files.canvas.lrhs);
  images.hrls = seen_through(std::move(images.hrls), files.hrls_windows.data, files.canvas.hrls);
  if (files.reference) {
    images.reference = load_layers(*files.reference, map_layers(*files.reference), kColor);
    sanitize_input(*images.reference, "reference", files.reference->path(), console);
  }
  return images;
}

}  // namespace raymeld::cli
