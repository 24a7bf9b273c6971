// Measures a device, so that raymeld fuse knows its fastest kernels.
#include <algorithm>
#include <chrono>
#include <limits>
#include <optional>

#include "choice/frame_times.h"
#include "cli/common/commands.h"
#include "cli/common/console.h"
#include "cli/common/models.h"
#include "cli/common/precisions.h"
#include "cli/common/sizes.h"
#include "fusion/tuner.h"
#include "platform/folders.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

constexpr uint32_t kGpuSeconds = 17;  // what follows takes a GPU less than 3 s

struct TuneArguments {
  std::vector<std::string> models{"x2", "x4"};
  std::string size = "1024x1024", device, precision = "auto";
  std::optional<uint32_t> seconds;
  bool again = false, json = false;
};

std::string shape_text(const Conv2dShape& s) {
  return fmt::format("{}x{} {}x{} {} -> {}", s.kernel, s.kernel, s.height, s.width, s.channels_in,
                     s.channels_out);
}

std::string kernel_text(const Conv2dShape& shape, const Conv2dKernel& k) {
  const std::string refused =
      shape.kernel > 1 && shape.most_tile < 4 ? "; F(4, 3) refused: not accurate enough" : "";
  if (k.algorithm == Algorithm::kMatrix) {
    const auto& [matrix, outputs, rows, subgroups, channels] = k.matrix;
    return fmt::format("matrix {}x{}x{}, {} outputs, {} subgroups of {} rows, {} channels{}", matrix.m,
                       matrix.n, matrix.k, outputs, subgroups, rows, channels, refused);
  }
  if (k.algorithm == Algorithm::kDirect) return "direct" + refused;
  if (k.algorithm == Algorithm::kColumns) return fmt::format("F({}, 3) in columns{}", k.tile, refused);
  const std::string name =
      k.algorithm == Algorithm::kPointwise ? "pointwise" : fmt::format("F({}, 3)", k.tile);
  return fmt::format("{}, {} outputs, bands of {}, order {}{}{}", name, k.outputs, k.band, k.order,
                     k.vector > 0 ? ", vectors" : "", refused);
}

void print_entry(const Conv2dShape& shape, const Tuning::Entry& entry) {
  print(fmt::format("{:<30} {:>9.3f} ms {:>8.1f} GFLOP/s {:>6.1f} x direct   {}\n", shape_text(shape),
                    entry.time_ms, shape.flop() / entry.time_ms * 1e-6, entry.direct_ms / entry.time_ms,
                    kernel_text(shape, entry.kernel)));
}

void run(const TuneArguments& arguments) {
  const auto device = Device::create({arguments.device});
  const std::filesystem::path folder = default_cache_folder();
  if (folder.empty())
    throw Error(
        "there is no folder for the measurements: neither XDG_CACHE_HOME nor HOME is an absolute path");
  const Storage storage = storage_for(kPrecisions.at(arguments.precision), device->info());
  const std::filesystem::path file = tuning_file(folder, *device, storage);
  std::vector<Conv2dShape> shapes;
  for (const std::string& name : arguments.models) {
    const Model model(find_model(name));
    const TileSize lrhs = lrhs_size(model, arguments.size);
    const std::vector<Conv2dShape> all = shapes_to_tune(*device, storage, model, lrhs);
    shapes.insert(shapes.end(), all.begin(), all.end());
  }
  std::ranges::sort(shapes);
  shapes.erase(std::unique(shapes.begin(), shapes.end()), shapes.end());
  const Console console(!arguments.json);
  const Tuning before = load_tuning(file);
  const bool known = !arguments.again && std::ranges::all_of(shapes, [&](const Conv2dShape& shape) {
    return before.entries.contains(shape);
  });
  if (known) {
    console.note(fmt::format("nothing to measure: {} has all {} shapes; --again measures them again",
                             file.string(), shapes.size()));
  } else {
    console.note(fmt::format("measuring {} ({})", device->info().name, device->info().driver));
    FrameTimes::forget(*device, folder);
    using Clock = std::chrono::steady_clock;
    const std::chrono::seconds most(arguments.seconds.value_or(
        device->info().is_cpu ? std::numeric_limits<uint32_t>::max() : kGpuSeconds));
    const auto start = Clock::now();
    tune_file(*device, storage, {.folder = folder, .shapes = shapes, .again = arguments.again},
              [&](const Conv2dShape& shape, const Tuning::Entry& entry) {
                if (!arguments.json) print_entry(shape, entry);
                check_interrupted();
                return Clock::now() - start < most;
              });
  }
  const Tuning tuning = load_tuning(file);
  const auto missing =
      std::ranges::count_if(shapes, [&](const auto& shape) { return !tuning.entries.contains(shape); });
  if (missing > 0)
    console.note(
        fmt::format("{} of {} shapes are left, those of the least work; the same command again "
                    "measures them, and --seconds gives more time",
                    missing, shapes.size()));
  if (!known)
    console.note(fmt::format("activations {}; wrote {}", tuning.addressed ? "by address" : "in buffers",
                             file.string()));
  if (!arguments.json) return;
  nlohmann::ordered_json json{{"device", device->info().name},
                              {"driver", device->info().driver},
                              {"file", file.string()},
                              {"addressed", tuning.addressed},
                              {"conv2d", nlohmann::ordered_json::array()}};
  for (const auto& [shape, entry] : tuning.entries) {
    json["conv2d"].push_back({{"shape", shape_text(shape)},
                              {"kernel", kernel_text(shape, entry.kernel)},
                              {"time_ms", entry.time_ms},
                              {"direct_ms", entry.direct_ms}});
  }
  print(json_text(json));
}

}  // namespace

void add_tune(CLI::App& app) {
  auto arguments = std::make_shared<TuneArguments>();
  CLI::App* command = app.add_subcommand(
      "tune", "Measures which kernels are fastest on a device, and saves the result for fuse");
  command
      ->add_option("--model", arguments->models,
                   "Measures the convolutions of these models: names, scales such as x4, or files; without "
                   "it x2 and x4")
      ->delimiter(',');
  command->add_option("--size", arguments->size, "Measures for fused images of this size")
      ->type_name("WxH")
      ->capture_default_str();
  command->add_option(
      "--device", arguments->device,
      "Runs on this Vulkan device: its index in raymeld devices, its UUID or part of its name");
  command->add_option("--precision", arguments->precision, "Measures kernels of this precision")
      ->check(CLI::IsMember({"auto", "fp32", "fp16"}))
      ->capture_default_str();
  command->add_option(
      "--seconds", arguments->seconds,
      fmt::format("Begins no convolution after so many seconds; those of the most work come first "
                  "(default: {} on GPUs, no limit on CPUs)",
                  kGpuSeconds));
  command->add_flag("--again", arguments->again, "Also measures convolutions that were measured before");
  command->add_flag("--json", arguments->json, "Prints one JSON object instead of text");
  command->footer("Example:\n  raymeld tune --model x4-fast --size 1920x1080");
  command->callback([arguments] { run(*arguments); });
}

}  // namespace raymeld::cli
