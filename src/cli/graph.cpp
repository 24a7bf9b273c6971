// Shows what the engine would do for a frame; needs no device.
#include "cli/common/commands.h"
#include "cli/common/console.h"
#include "cli/common/models.h"
#include "cli/common/sizes.h"
#include "cli/graph_text.h"
#include "networks/network.h"

namespace raymeld::cli {
namespace {

struct GraphArguments {
  std::string model, size, precision = "fp32";
  bool dot = false;
};

void show(const GraphArguments& arguments) {
  const Model model(find_model(arguments.model));
  const TileSize lrhs = lrhs_size(model, arguments.size), full = parse_size(arguments.size);
  Graph graph(arguments.precision == "fp16" ? Storage::kFloat16 : Storage::kFloat32);
  network(graph, model, lrhs.height, lrhs.width, 0);
  graph.plan();
  if (arguments.dot) return print(graph_dot(graph, model.name()));
  const Architecture& architecture = model.architecture();
  const uint32_t halo = receptive_halo(architecture);
  print(fmt::format("model {}, {} parameters, {} x {} pixels, {}, halo {}\n\n", model.name(),
                    model.parameters(), full.width, full.height, arguments.precision,
                    halo == kWholeFrame
                        ? "the whole frame"
                        : fmt::format("{} {}", halo, architecture.reads_lrhs() ? "LRHS pixels" : "pixels")));
  print(passes_text(graph) + "\n" + memory_text(graph));
}

}  // namespace

void add_graph(CLI::App& app) {
  auto arguments = std::make_shared<GraphArguments>();
  CLI::App* command =
      app.add_subcommand("graph", "Shows a frame's dispatches, barriers and memory plan; needs no device");
  command->add_option("--model", arguments->model, "Shows this model: a name, a scale such as x4, or a file")
      ->required();
  command->add_option("--size", arguments->size, "Plans for a fused image of this size")
      ->required()
      ->type_name("WxH");
  command->add_option("--precision", arguments->precision, "Plans for activations of this type")
      ->check(CLI::IsMember({"fp32", "fp16"}))
      ->capture_default_str();
  command->add_flag("--dot", arguments->dot, "Writes a Graphviz graph instead");
  command->footer("Example:\n  raymeld graph --model x4 --size 1920x1080 --dot | dot -Tsvg > x4.svg");
  command->callback([arguments] { show(*arguments); });
}

}  // namespace raymeld::cli
