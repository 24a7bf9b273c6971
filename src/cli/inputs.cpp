#include "cli/inputs.h"

#include "error.h"

namespace raymeld::cli {

const std::vector<std::string> kColor = {"color"};

LayerMap map_color(const ExrFile& file, const LayerChoice& choice) {
  LayerChoice color = choice, scope, name;
  std::erase_if(color.overrides, [](const auto& item) { return item.first != "color"; });
  scope = name = color;
  scope.overrides.clear();
  name.view_layer.clear(), name.view.clear();
  for (const LayerChoice& part : {color, scope, name}) {
    try {
      LayerMap map = map_layers(file, part);
      if (map.layers.contains("color")) return map;
    } catch (const Error&) {  // this part does not fit
    }
  }
  return map_layers(file);
}

void sanitize_input(Image& image, const char* role, const std::filesystem::path& path, Console& console) {
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

}  // namespace raymeld::cli
