// What the engine would do for a frame, without any device.
#include <charconv>

#include "cli/commands.h"
#include "cli/console.h"
#include "cli/graph_text.h"
#include "cli/models.h"
#include "network.h"
#include "tiling.h"

namespace raymeld::cli {
namespace {

struct GraphArguments {
  std::string model, size, precision = "fp32";
  bool dot = false;
};

// Height and width of the `size` "WxH", in pixels.
TileSize parse_size(const std::string& size) {
  TileSize result;
  const char* end = size.data() + size.size();
  const auto width = std::from_chars(size.data(), end, result.width);
  if (width.ec == std::errc() && width.ptr != end && *width.ptr == 'x') {
    const auto height = std::from_chars(width.ptr + 1, end, result.height);
    if (height.ec == std::errc() && height.ptr == end && result.width > 0 && result.height > 0) return result;
  }
  throw Error("--size is '{}', expected WxH such as 1920x1080", size);
}

void show(const GraphArguments& arguments) {
  const Model model(find_model(arguments.model));
  const uint32_t scale = model.architecture().scale;
  const TileSize full = parse_size(arguments.size);
  if (full.width % scale != 0 || full.height % scale != 0) {
    throw Error("--size {} is no multiple of the scale {} of model {}", arguments.size, scale, model.name());
  }
  Graph graph(arguments.precision == "fp16" ? Storage::kFloat16 : Storage::kFloat32);
  network(graph, model, full.height / scale, full.width / scale, 0);
  graph.plan();
  if (arguments.dot) return print(graph_dot(graph, model.name()));
  print(fmt::format("model {}, {} parameters, {} x {} pixels, {}, halo {} LRHS pixels\n\n", model.name(),
                    model.parameters(), full.width, full.height, arguments.precision,
                    receptive_halo(model.architecture())));
  print(passes_text(graph) + "\n" + memory_text(graph));
}

}  // namespace

void add_graph(CLI::App& app) {
  auto arguments = std::make_shared<GraphArguments>();
  CLI::App* command =
      app.add_subcommand("graph", "Shows a frame's dispatches, barriers and memory plan; needs no device");
  command->add_option("--model", arguments->model, "A model's name, a scale such as x4, or a file")
      ->required();
  command->add_option("--size", arguments->size, "Of the fused image")->required()->type_name("WxH");
  command->add_option("--precision", arguments->precision, "fp32 or fp16")
      ->check(CLI::IsMember({"fp32", "fp16"}))
      ->capture_default_str();
  command->add_flag("--dot", arguments->dot, "Writes a Graphviz graph instead");
  command->footer("Example:\n  raymeld graph --model x4 --size 1920x1080 --dot | dot -Tsvg > x4.svg");
  command->callback([arguments] { show(*arguments); });
}

}  // namespace raymeld::cli
