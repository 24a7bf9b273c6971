// Compiles a frame's kernels on a device and shows what the driver's compiler made of them.
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "cli/common/commands.h"
#include "cli/common/console.h"
#include "cli/common/models.h"
#include "cli/common/precisions.h"
#include "cli/common/sizes.h"
#include "engine/kernel.h"
#include "engine/pipeline_statistics.h"
#include "fusion/fuser_options.h"
#include "fusion/tuner.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

using Json = nlohmann::ordered_json;

struct CompileArguments {
  std::string model, size, device, precision = "auto";
  bool matrices = false, json = false;
};

// Holds a layer's work by one kernel, which it may do in several dispatches.
struct LayerWork {
  std::string name;
  uint32_t dispatches = 0;
  double workgroups = 0, flop = 0, bytes = 0;
  double trips = 0;  // the sum of Pass::loop_trips over the workgroups
};

struct Compiled {
  std::string name;
  std::vector<uint32_t> constants;
  uint32_t invocations = 0;  // invocations of a workgroup
  double time_ms = 0;
  std::vector<PipelineExecutable> executables;
  std::vector<PipelineExecutable> unrolled;  // its loops of unknown length do two steps at a time
  std::vector<LayerWork> layers;

  void add(const Pass& pass) {
    auto layer = std::ranges::find(layers, pass.name, &LayerWork::name);
    if (layer == layers.end()) layer = layers.insert(layer, {.name = pass.name});
    ++layer->dispatches;
    const double workgroups = double(pass.groups[0]) * pass.groups[1] * pass.groups[2];
    layer->workgroups += workgroups;
    layer->trips += workgroups * pass.loop_trips;
    layer->flop += pass.flop;
    layer->bytes += pass.bytes;
  }
};

// Compiles one kernel after another, without a pipeline cache. Returns them in the order of their first
// passes.
std::vector<Compiled> compile_all(const Device& device, const Graph& graph) {
  std::vector<Compiled> kernels;
  std::map<KernelRecipe, size_t> known;
  const std::vector<KernelRecipe> recipes = kernel_recipes(graph, device.info());
  for (size_t i = 0; i < recipes.size(); ++i) {
    const auto [at, is_new] = known.emplace(recipes[i], kernels.size());
    if (is_new) {
      check_interrupted();
      const Stopwatch watch;
      const Kernel kernel(device, VK_NULL_HANDLE, recipes[i]);
      const double time_ms = watch.ms();
      std::vector<PipelineExecutable> unrolled;
      if (graph.passes()[i].loop_trips > 0 && device.tells_statistics()) {
        KernelRecipe recipe = recipes[i];
        recipe.unroll = 2;
        unrolled = pipeline_executables(device, Kernel(device, VK_NULL_HANDLE, recipe).pipeline());
      }
      kernels.push_back({recipes[i].name,
                         recipes[i].constants,
                         workgroup_invocations(recipes[i]),
                         time_ms,
                         pipeline_executables(device, kernel.pipeline()),
                         std::move(unrolled),
                         {}});
    }
    kernels[at->second].add(graph.passes()[i]);
  }
  return kernels;
}

Json to_json(const PipelineExecutable& executable) {
  Json statistics = Json::object();
  for (const auto& [name, value] : executable.statistics) statistics[name] = value;
  return {{"name", executable.name}, {"subgroup_size", executable.subgroup_size}, {"statistics", statistics}};
}

Json to_json(const Compiled& kernel) {
  Json json{{"kernel", kernel.name},
            {"constants", kernel.constants},
            {"invocations", kernel.invocations},
            {"compile_ms", kernel.time_ms},
            {"executables", Json::array()}};
  for (const PipelineExecutable& executable : kernel.executables)
    json["executables"].push_back(to_json(executable));
  json["unrolled"] = Json::array();
  for (const PipelineExecutable& executable : kernel.unrolled)
    json["unrolled"].push_back(to_json(executable));
  for (const LayerWork& layer : kernel.layers)
    json["layers"].push_back({{"name", layer.name},
                              {"dispatches", layer.dispatches},
                              {"workgroups", layer.workgroups},
                              {"loop_trips", layer.trips / layer.workgroups},
                              {"flop", layer.flop},
                              {"bytes", layer.bytes}});
  return json;
}

std::string to_text(const Compiled& kernel) {
  std::vector<std::string> layers;
  for (const LayerWork& layer : kernel.layers) layers.push_back(layer.name);
  std::string text = fmt::format("{}, {:.1f} ms: {}\n", kernel.name, kernel.time_ms, fmt::join(layers, ", "));
  for (const PipelineExecutable& executable : kernel.executables) {
    text += fmt::format("   {}, subgroups of {}", executable.name, executable.subgroup_size);
    for (const auto& [name, value] : executable.statistics) text += fmt::format("; {} {:.12g}", name, value);
    text += "\n";
  }
  return text;
}

// Returns kernels that convolve by cooperative matrices wherever these can.
Kernels by_matrices(const Device& device, const FuserOptions& options) {
  const std::optional<CooperativeMatrix>& matrix = device.info().cooperative_matrix;
  if (!matrix) throw Error("device {} has no cooperative matrices", device.info().name);
  if (options.storage != Storage::kFloat16)
    throw Error("--matrices with fp32, expected fp16: cooperative matrices have 16 bits");
  Kernels kernels = options.kernels;
  kernels.conv2d = [matrix = *matrix, other = kernels.conv2d](const Conv2dShape& shape) {
    return shape.kernel == 5 ? other(shape) : first_matrix_guess(matrix, shape);
  };
  return kernels;
}

void run(const CompileArguments& arguments) {
  const auto device = Device::create({.selector = arguments.device, .pipeline_statistics = true});
  const Model model(find_model(arguments.model));
  const TileSize lrhs = lrhs_size(model, arguments.size), full = parse_size(arguments.size);
  FuserOptions options =
      fuser_options(*device, model, kPrecisions.at(arguments.precision), KernelChoice::kAuto);
  if (arguments.matrices) options.kernels = by_matrices(*device, options);
  const FusePlan plan = plan_fusion(model, lrhs.height, lrhs.width, device->info(), options);
  const std::vector<Compiled> kernels = compile_all(*device, plan.graph);
  double total_ms = 0;
  for (const Compiled& kernel : kernels) total_ms += kernel.time_ms;
  const char* precision = options.storage == Storage::kFloat16 ? "fp16" : "fp32";
  if (arguments.json) {
    Json json{{"device", device->info().name},
              {"driver", device->info().driver},
              {"model", model.name()},
              {"width", full.width},
              {"height", full.height},
              {"precision", precision},
              {"tiles", plan.tiling.count()},
              {"dispatches", plan.graph.passes().size()},
              {"barriers", plan.graph.barrier_count()},
              {"compile_ms", total_ms},
              {"kernels", Json::array()}};
    for (const Compiled& kernel : kernels) json["kernels"].push_back(to_json(kernel));
    return print(json_text(json));
  }
  print(fmt::format("model {}, {} x {} pixels, {}, on {} ({})\n\n", model.name(), full.width, full.height,
                    precision, device->info().name, device->info().driver));
  for (const Compiled& kernel : kernels) print(to_text(kernel));
  if (!device->tells_statistics()) print("The driver tells nothing of its kernels.\n");
  print(fmt::format("{} kernels in {:.1f} ms; {} dispatches, {} barriers, {} tile(s)\n", kernels.size(),
                    total_ms, plan.graph.passes().size(), plan.graph.barrier_count(), plan.tiling.count()));
}

}  // namespace

void add_compile(CLI::App& app) {
  auto arguments = std::make_shared<CompileArguments>();
  CLI::App* command = app.add_subcommand(
      "compile", "Compiles a frame's kernels on a device, and shows what its driver tells of each");
  command
      ->add_option("--model", arguments->model, "Compiles this model: a name, a scale such as x4, or a file")
      ->required();
  command->add_option("--size", arguments->size, "Plans for a fused image of this size")
      ->required()
      ->type_name("WxH");
  command->add_option(
      "--device", arguments->device,
      "Compiles on this Vulkan device: its index in raymeld devices, its UUID or part of its name");
  command->add_option("--precision", arguments->precision, "Compiles kernels of this precision")
      ->check(CLI::IsMember({"auto", "fp32", "fp16"}))
      ->capture_default_str();
  command->add_flag("--matrices", arguments->matrices,
                    "Compiles convolutions by cooperative matrices, where they can, instead of the defaults");
  command->add_flag("--json", arguments->json, "Prints one JSON object instead of text");
  command->footer(
      "Times are those of one thread without a pipeline cache of raymeld's; a driver may have its own.\n\n"
      "Example:\n  raymeld compile --model x4 --size 1920x1080");
  command->callback([arguments] { run(*arguments); });
}

}  // namespace raymeld::cli
