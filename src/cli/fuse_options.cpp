#include <array>
#include <charconv>
#include <climits>
#include <cmath>

#include "cli/choice.h"
#include "cli/commands.h"
#include "cli/precisions.h"
#include "cli/sequence.h"
#include "exposure.h"

namespace raymeld::cli {
namespace {

std::string finite(const std::string& text) {
  return std::isfinite(std::strtof(text.c_str(), nullptr)) ? "" : text + " is not finite";
}

// 0 for "auto". Throws Error.
float parse_exposure(const std::string& text) {
  if (text == "auto") return 0;
  if (text == "off") return 1;
  char* end = nullptr;
  const float exposure = std::strtof(text.c_str(), &end);
  if (*end != '\0') throw Error("expected auto, off or a number");
  check_exposure(exposure);
  return exposure;
}

// An option whose value is what `parse` makes of its text; where that throws Error, the text is no valid one.
template <typename Value>
CLI::Option* add_parsed(CLI::App& command, const std::string& name, Value& value,
                        Value (*parse)(const std::string&), const std::string& description) {
  const auto read = [name, &value, parse](const std::string& text) {
    try {
      value = parse(text);
    } catch (const Error& error) {
      throw CLI::ValidationError(name, fmt::format("'{}': {}", text, error.what()));
    }
  };
  return command.add_option_function<std::string>(name, read, description);
}

// None for "auto", 0 for "off". Throws Error.
std::optional<float> parse_threshold(const std::string& text) {
  if (text == "auto") return std::nullopt;
  if (text == "off") return 0;
  char* end = nullptr;
  const float threshold = std::strtof(text.c_str(), &end);
  if (*end == '\0' && threshold > 0 && threshold <= 1) return threshold;
  throw Error("expected auto, off or a number up to 1");
}

// Throws Error.
std::optional<Imath::Box2i> parse_window(const std::string& text) {
  std::array<int, 4> numbers{};
  const char *next = text.data(), *end = next + text.size();
  bool valid = true;
  for (size_t i = 0; i < numbers.size() && valid; ++i) {
    const auto [behind, error] = std::from_chars(next, end, numbers[i]);
    const bool last = i + 1 == numbers.size();
    valid = error == std::errc() && (last ? behind == end : behind != end && *behind == ',');
    next = behind + 1;
  }
  const auto [x, y, width, height] = numbers;
  const int64_t max_x = int64_t{x} + width - 1, max_y = int64_t{y} + height - 1;
  if (valid && width > 0 && height > 0 && max_x <= INT_MAX && max_y <= INT_MAX)
    return Imath::Box2i({x, y}, {int(max_x), int(max_y)});
  throw Error("expected X,Y,WIDTH,HEIGHT such as 640,360,320,240, of at least one pixel");
}

void add_files(CLI::App& command, FuseArguments& a) {
  command.add_option("--lrhs", a.lrhs, "The small, many-sample render: OpenEXR with colour")->required();
  command.add_option("--hrls", a.hrls, "The full-size, few-sample render: OpenEXR with the model's layers")
      ->required();
  command.add_option("-o,--output", a.output,
                     "The fused image: OpenEXR, windows, attributes and alpha from HRLS");
  command
      .add_option("--map", a.map,
                  "Where layers are: a preset (generic, cycles, arnold, pbrt, renderman), LAYER=PREFIX, "
                  "LAYER=CHANNEL,CHANNEL,CHANNEL, viewlayer=NAME or view=NAME; may be repeated")
      ->type_name("ITEM")
      ->allow_extra_args(false);
  command.add_option("--map-lrhs", a.lrhs_map, "The same for the LRHS file alone")
      ->type_name("ITEM")
      ->allow_extra_args(false);
  command
      .add_option("--lrhs-sampling", a.sampling,
                  "Where LRHS samples lie: nearest (every scale-th pixel, as degrade makes it), centered (a "
                  "real low-resolution render), auto (what the file says, else as the model was trained)")
      ->check(CLI::IsMember({"auto", "nearest", "centered"}))
      ->capture_default_str();
  add_parsed(
      command, "--input-exposure", a.input_exposure, parse_exposure,
      "What radiance is multiplied by for the network, and the output divided by: a factor, off (1), or "
      "auto (from LRHS, for models that were trained at one brightness; else 1)")
      ->type_name("auto|off|FACTOR")
      ->default_str("auto");
  add_parsed(
      command, "--window", a.window, parse_window,
      "The part of HRLS that is fused and written, in the pixels of its file: as it would be in the whole "
      "frame, for about the cost of these pixels")
      ->type_name("X,Y,W,H");
  command.add_option("--output-type", a.output_type, "half, float, or auto: as the HRLS colour")
      ->check(CLI::IsMember({"auto", "half", "float"}))
      ->capture_default_str();
  command.add_flag("--keep-layers", a.keep_layers, "Passes all other HRLS channels through, bit by bit");
}

// The model, by name or by what is expected of it.
void add_model(CLI::App& command, FuseArguments& a) {
  CLI::Option* model = command.add_option(
      "--model", a.model,
      "A model's name, a scale such as x4, or a file; without it the scale follows from the sizes");
  CLI::Option* quality = add_parsed(command, "--quality", a.wish, parse_quality,
                                    "Chooses the model: high, balanced (the default), fast, or from 0, the "
                                    "fastest, to 100, the best; in "
                                    "between, a doubling of the time must bring 0.1 dB times (100 - N) / N")
                             ->type_name("high|balanced|fast|N")
                             ->excludes(model);
  CLI::Option* budget =
      add_parsed(
          command, "--budget", a.wish, parse_budget,
          "Chooses the best model that takes no longer than this for a frame, files apart; measures them at "
          "its size, once on each device")
          ->type_name("TIME")
          ->excludes(model)
          ->excludes(quality);
  add_parsed(command, "--target-psnr", a.wish, parse_target,
             "Chooses the fastest model that is expected to reach it, as far as the inputs tell")
      ->type_name("DB")
      ->excludes(model)
      ->excludes(quality)
      ->excludes(budget);
}

void add_run(CLI::App& command, FuseArguments& a) {
  command.add_option("--device", a.device, "An index of raymeld devices, a UUID or part of a name");
  command
      .add_option_function<std::string>(
          "--precision", [&a](const std::string& name) { a.precision = kPrecisions.at(name); },
          "fp32, fp16 (activations and weights in 16 bits, sums in 32), or auto: fp16 on a GPU that has it, "
          "and fp32 "
          "for tiles that it cannot hold")
      ->check(CLI::IsMember({"auto", "fp32", "fp16"}))
      ->default_str("auto");
  command
      .add_option_function<std::string>(
          "--overflow",
          [&a](const std::string& name) {
            a.overflow = name == "warn"   ? Overflow::kWarn
                         : name == "redo" ? Overflow::kRedo
                                          : Overflow::kError;
          },
          "With --precision fp16, of values that it cannot hold: error, warn (with their number), or redo: "
          "these tiles "
          "in fp32, as auto does")
      ->check(CLI::IsMember({"error", "warn", "redo"}))
      ->default_str("error");
  command
      .add_option_function<std::string>(
          "--kernels",
          [&a](const std::string& name) {
            a.kernels = name == "direct" ? KernelChoice::kDirect : KernelChoice::kAuto;
          },
          "auto: the fastest, as raymeld tune measured, or a default; direct: plain sums, the same bits "
          "whatever the "
          "tiles")
      ->check(CLI::IsMember({"auto", "direct"}))
      ->default_str("auto");
  command.add_option("--max-memory", a.max_memory_mib, "Of the device, in MiB; larger frames are tiled")
      ->type_name("MB")
      ->check(CLI::Range(uint64_t{1}, uint64_t{1} << 40));
  add_parsed(command, "--adaptive", a.threshold, parse_threshold,
             "Blocks of 8x8 LRHS pixels in which LRHS and HRLS agree, as empty ones do, take their mean "
             "instead of the "
             "network: to within a threshold on the network's scale, where 0.01 is about a step of an 8-bit "
             "display; off; or "
             "auto: 0.01 where it pays")
      ->type_name("auto|off|THRESHOLD")
      ->default_str("auto");
  command.add_flag("--dry-run", a.dry_run, "Shows the layers, the plan and its memory; writes nothing");
}

void add_reports(CLI::App& command, FuseArguments& a) {
  command.add_option("--preview", a.preview, "Writes the fused image as sRGB PNG too");
  command.add_option("--preview-before-after", a.before_after,
                     "Writes a PNG: bicubic LRHS, HRLS, fused and, if given, the reference side by side");
  command.add_option("--exposure", a.exposure_stops, "Of the previews")->type_name("STOPS")->check(finite);
  command.add_option("--reference", a.reference, "Measures against this OpenEXR file");
  command
      .add_flag("--profile", a.profile,
                "Shows the time of each layer; the frame runs twice, and the second run is measured")
      ->excludes("--changed-only");
  command.add_option("--dump", a.dump, "Writes each layer's output as NumPy file to this folder")
      ->type_name("DIR")
      ->excludes("--changed-only");
  command.add_flag("--json", a.json, "One JSON object on stdout");
  CLI::Option* quiet =
      command.add_flag("--quiet", a.quiet, "Says nothing but warnings and errors, and shows no progress");
  command.add_flag("--verbose", a.verbose, "Also says which channels each layer comes from")->excludes(quiet);
}

void add_sequence(CLI::App& command, SequenceArguments& a, FuseArguments& frame) {
  CLI::Option* frames =
      add_parsed(
          command, "--frames", a.frames, parse_frames,
          "Fuses a sequence: 1-240, 1-240x2, 1-10,15. In the file names above and below, the last run of # "
          "is the frame's number, padded to its length; one of --lrhs and --hrls may do without")
          ->type_name("RANGES");
  add_parsed(command, "--shard", a.shard, parse_shard,
             "The i-th of n processes that share the frames: every n-th frame, from the i-th on")
      ->type_name("I/N")
      ->needs(frames);
  command
      .add_flag("--resume", a.resume,
                "Skips frames whose outputs are all there, none older than an input or the file of --model")
      ->needs(frames);
  command
      .add_flag("--changed-only", frame.changed_only,
                "Computes only what depends on pixels that changed since the frame before, and takes the "
                "rest of its output; where exposures differ everything is computed, so give --input-exposure "
                "a factor or off")
      ->needs(frames);
}

}  // namespace

void add_fuse(CLI::App& app) {
  auto arguments = std::make_shared<FuseArguments>();
  auto sequence = std::make_shared<SequenceArguments>();
  CLI::App* command = app.add_subcommand("fuse", "Fuses an LRHS and an HRLS render, or sequences of them");
  add_files(*command, *arguments);
  add_sequence(*command, *sequence, *arguments);
  add_model(*command, *arguments);
  add_run(*command, *arguments);
  add_reports(*command, *arguments);
  command->footer(
      "In what is read, NaN counts as 0 and infinities as +-65504; a warning says how many there were.\n\n"
      "Examples:\n"
      "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr --preview fused.png\n"
      "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr --model x4-fast --reference truth.exr "
      "--json\n"
      "  raymeld fuse --lrhs low.exr --hrls high.exr --map cycles --map albedo=ViewLayer.DiffCol --dry-run\n"
      "  raymeld fuse --lrhs low.####.exr --hrls high.####.exr -o fused.####.exr --frames 1-240 --resume");
  command->callback([arguments, sequence] {
    if (arguments->output.empty() && !arguments->dry_run) throw CLI::RequiredError("--output");
    if (!sequence->frames.empty()) return run_sequence(*sequence, *arguments);
    check_no_patterns(*arguments);
    run_fuse(*arguments);
  });
}

}  // namespace raymeld::cli
