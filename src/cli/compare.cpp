#include <array>

#include "choice/metrics.h"
#include "cli/common/commands.h"
#include "cli/common/help.h"
#include "cli/common/inputs.h"
#include "cli/common/outputs.h"
#include "cli/common/quality.h"
#include "error.h"
#include "io/layers_from_exr.h"
#include "io/png.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

struct CompareArguments {
  std::string image, reference, error_map;
  std::vector<std::string> map;
  bool json = false;
};

Image load_color(const char* role, const fs::path& path, const LayerChoice& choice, Console& console) {
  ExrFile file(path);
  Image image = load_layers(file, map_layers(file, choice), kColor);
  sanitize_input(image, role, path, console);
  return image;
}

void compare(const CompareArguments& arguments) {
  const std::array<fs::path, 2> inputs = {arguments.image, arguments.reference};
  std::vector<fs::path> outputs;
  if (!arguments.error_map.empty()) outputs.push_back(arguments.error_map);
  check_outputs(outputs, inputs);
  const LayerChoice choice = parse_layer_choice(arguments.map);
  Console console(false);
  const Image image = load_color("image", arguments.image, choice, console);
  const Image reference = load_color("reference", arguments.reference, choice, console);
  if (image.width != reference.width || image.height != reference.height) {
    throw Error("cannot compare '{}', {} x {}, with '{}', {} x {}: the sizes must be equal", arguments.image,
                image.width, image.height, arguments.reference, reference.width, reference.height);
  }
  const Quality quality = measure(image, reference);
  StagedFiles staged;
  for (const fs::path& map : outputs) {
    staged.add(map, [&](AtomicFile& file) { write_png(file, heat_map(relmse_map(image, reference))); });
  }
  const QualityTable rows = {{"image", quality}};
  nlohmann::ordered_json json = to_json(rows)["image"];
  json["warnings"] = to_json(console.warnings());
  print(arguments.json ? json_text(json) : table(rows));
  staged.commit();
}

}  // namespace

void add_compare(CLI::App& app) {
  auto arguments = std::make_shared<CompareArguments>();
  CLI::App* command = app.add_subcommand("compare", "Measures an image against its reference");
  command->add_option("IMAGE", arguments->image, "Reads the image from this OpenEXR file")->required();
  command
      ->add_option("REFERENCE", arguments->reference,
                   "Reads the reference from this OpenEXR file of the same size")
      ->required();
  command
      ->add_option("--error-map", arguments->error_map,
                   "Writes a PNG of each pixel's RelMSE (0.5, 0.01): black up to 1e-4, yellow from 1")
      ->check(ends_in(".png"));
  command->add_option("--map", arguments->map, "Maps channels to layers in both files, as in fuse")
      ->type_name("ITEM")
      ->allow_extra_args(false);
  command->add_flag("--json", arguments->json, "Prints one JSON object instead of a table");
  command->footer(
      "psnr_db is measured in sRGB; relmse_bcr is the relative squared error with (0.5, 0.01),\n"
      "relmse_gharbi that with (1, 1e-4).\n\nExample:\n  raymeld compare fused.exr reference.exr --error-map "
      "error.png");
  command->callback([arguments] { compare(*arguments); });
}

}  // namespace raymeld::cli
