#include <cmath>

#include "cli/fuse/choice.h"
#include "cli/common/commands.h"
#include "cli/fuse/fuse_parse.h"
#include "cli/common/help.h"
#include "cli/common/precisions.h"
#include "cli/sequence/sequence.h"

namespace raymeld::cli {
namespace {

std::string finite(const std::string& text) {
  return std::isfinite(std::strtof(text.c_str(), nullptr)) ? "" : text + " is not finite";
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

// An option that takes one of the names in `values`; the first is the default.
template <typename Value>
CLI::Option* add_named(CLI::App& command, const std::string& name, Value& value,
                       const std::vector<std::pair<std::string, Value>>& values,
                       const std::string& description) {
  std::vector<std::string> names;
  for (const auto& [own, meaning] : values) names.push_back(own);
  const auto read = [&value, values](const std::string& text) {
    value = std::ranges::find(values, text, &std::pair<std::string, Value>::first)->second;
  };
  return command.add_option_function<std::string>(name, read, description)
      ->check(CLI::IsMember(names))
      ->default_str(names.front());
}

void add_files(CLI::App& command, FuseArguments& a) {
  command.add_option("--lrhs", a.lrhs, "Reads the small, many-sample render from this OpenEXR file")
      ->required()
      ->type_name("FILE");
  command
      .add_option("--hrls", a.hrls,
                  "Reads the full-size, few-sample render and its guide layers from this OpenEXR file")
      ->required()
      ->type_name("FILE");
  command
      .add_option("-o,--output", a.output,
                  "Writes the fused image to this OpenEXR file; windows, attributes and alpha are those of "
                  "HRLS")
      ->type_name("FILE")
      ->check(ends_in(".exr", "; --preview writes a PNG"));
  command.add_option("--preview", a.preview, "Writes the fused image as an sRGB PNG too")
      ->type_name("FILE")
      ->check(ends_in(".png"));
  command
      .add_option("--map", a.map,
                  "Says where layers are: a preset (generic, cycles, arnold, pbrt, renderman), LAYER=PREFIX, "
                  "LAYER=CHANNEL,CHANNEL,CHANNEL, viewlayer=NAME or view=NAME; may be repeated")
      ->type_name("ITEM")
      ->allow_extra_args(false);
}

void add_more_files(CLI::App& command, FuseArguments& a) {
  command.add_option("--map-lrhs", a.lrhs_map, "Says the same of the LRHS file alone")
      ->type_name("ITEM")
      ->allow_extra_args(false);
  command
      .add_option(
          "--lrhs-sampling", a.sampling,
          "Says what LRHS is: centered (an ordinary small render), nearest (every scale-th pixel of a full "
          "one, as degrade makes it) or auto (what the file says, else what the pixels of both files show)")
      ->check(CLI::IsMember({"auto", "nearest", "centered"}))
      ->capture_default_str();
  add_named<PairCheck>(
      command, "--pair-check", a.pair_check,
      {{"refuse", PairCheck::kRefuse}, {"warn", PairCheck::kWarn}, {"off", PairCheck::kOff}},
      "Says what files that do not belong together are: an error, a warning, or not looked for; both "
      "but off make LRHS as bright as HRLS");
  add_parsed(command, "--window", a.window, parse_window,
             "Fuses and writes only this part of HRLS, in the pixels of its file: as it would be in the "
             "whole frame, for about the cost of these pixels")
      ->type_name("X,Y,W,H");
  command
      .add_option("--output-type", a.output_type,
                  "Writes channels of this type; auto takes that of HRLS's color")
      ->check(CLI::IsMember({"auto", "half", "float"}))
      ->capture_default_str();
  command.add_flag("--keep-layers", a.keep_layers, "Passes all other HRLS channels through, bit by bit");
  command
      .add_option("--preview-before-after", a.before_after,
                  "Writes a PNG with bicubic LRHS, HRLS, fused and, if given, the reference side by side")
      ->type_name("FILE")
      ->check(ends_in(".png"));
  command.add_option("--exposure", a.exposure_stops, "Brightens the previews by this many stops")
      ->type_name("STOPS")
      ->check(finite);
}

// The model, by name or by what is expected of it.
void add_model(CLI::App& command, FuseArguments& a) {
  CLI::Option* model = command
                           .add_option("--model", a.model,
                                       "Takes a model by its name, by a scale such as x4, or from a file; "
                                       "without it the scale follows from the sizes")
                           ->type_name("MODEL");
  CLI::Option* quality =
      add_parsed(command, "--quality", a.wish, parse_quality,
                 "Chooses the model: high, balanced (the default), fast, or from 0, the fastest, to 100, the "
                 "best; in between, a doubling of the time must bring 0.1 dB times (100 - N) / N")
          ->type_name("high|balanced|fast|N")
          ->excludes(model);
  CLI::Option* budget =
      add_parsed(command, "--budget", a.wish, parse_budget,
                 "Chooses the best model that takes no longer than this for a frame, files apart; measures "
                 "them at its size, once on each device")
          ->type_name("TIME")
          ->group(kMoreOptions)
          ->excludes(model)
          ->excludes(quality);
  add_parsed(command, "--target-psnr", a.wish, parse_target,
             "Chooses the fastest model that is expected to reach it, as far as the inputs tell, else the "
             "best")
      ->type_name("DB")
      ->group(kMoreOptions)
      ->excludes(model)
      ->excludes(quality)
      ->excludes(budget);
}

void add_run(CLI::App& command, FuseArguments& a) {
  command
      .add_option("--device", a.device,
                  "Runs on this Vulkan device: an index of raymeld devices, a UUID or part of a name")
      ->type_name("DEVICE");
  add_named<Precision>(command, "--precision", a.precision,
                       {{"auto", Precision::kAuto}, {"fp32", Precision::kFp32}, {"fp16", Precision::kFp16}},
                       "Computes in fp32, in fp16 (activations and weights in 16 bits, sums in 32) or, with "
                       "auto, in fp16 on a "
                       "GPU that has it and in fp32 in tiles that it cannot hold");
  add_named<Overflow>(
      command, "--overflow", a.overflow,
      {{"error", Overflow::kError}, {"warn", Overflow::kWarn}, {"redo", Overflow::kRedo}},
      "Says what values that --precision fp16 cannot hold are: an error, a warning with their number, or "
      "tiles to compute again in fp32, as auto does");
  add_named<KernelChoice>(
      command, "--kernels", a.kernels, {{"auto", KernelChoice::kAuto}, {"direct", KernelChoice::kDirect}},
      "Computes by the fastest kernels, as raymeld tune measured or by default, or by direct ones: plain "
      "sums, the same bits whatever the tiles");
  command
      .add_option("--max-memory", a.max_memory_mib,
                  "Takes no more memory of the device than this, in MiB; larger frames are tiled")
      ->type_name("MIB")
      ->check(CLI::Range(uint64_t{1}, uint64_t{1} << 40));
  add_parsed(command, "--input-exposure", a.input_exposure, parse_exposure,
             "Multiplies radiance by this factor for the network and divides its output by it: a number, off "
             "(1), or auto (from LRHS, for models that were trained at one brightness; else 1)")
      ->type_name("auto|off|FACTOR")
      ->default_str("auto");
}

void add_reports(CLI::App& command, FuseArguments& a) {
  command.add_flag("--dry-run", a.dry_run, "Shows the layers, the plan and its memory; writes nothing");
  CLI::Option* quiet =
      command.add_flag("--quiet", a.quiet, "Says nothing but warnings and errors, and shows no progress");
  command.add_flag("--verbose", a.verbose, "Also says which channels each layer comes from")->excludes(quiet);
  command.add_flag("--json", a.json, "Prints one JSON object; where the command fails, one with an error");
}

void add_more_reports(CLI::App& command, FuseArguments& a) {
  command.add_option("--reference", a.reference, "Measures the fused image against this OpenEXR file")
      ->type_name("FILE");
  command
      .add_flag("--profile", a.profile,
                "Shows the time of each layer; the frame runs twice, and the second run is measured")
      ->excludes("--changed-only");
  command.add_option("--dump", a.dump, "Writes each layer's output as a NumPy file to this folder")
      ->type_name("DIR")
      ->excludes("--changed-only");
}

CLI::Option* add_frames(CLI::App& command, SequenceArguments& a) {
  return add_parsed(command, "--frames", a.frames, parse_frames,
                    "Fuses a sequence: 1-240, 1-240x2, 1-10,15. In each file name the last run of # is the "
                    "frame's number, padded to its length; one of --lrhs and --hrls may do without")
      ->type_name("RANGES");
}

void add_more_sequence(CLI::App& command, CLI::Option* frames, SequenceArguments& a, FuseArguments& frame) {
  add_parsed(command, "--shard", a.shard, parse_shard,
             "Fuses the i-th share of n: every n-th frame, from the i-th on")
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

// Each option goes to the group that is set when it is added.
void add_options(CLI::App& command, FuseArguments& a, SequenceArguments& sequence) {
  const auto group = [&](const char* name) { command.option_defaults()->group(name); };
  group("Files");
  add_files(command, a);
  group("Model and sequence");
  add_model(command, a);
  CLI::Option* frames = add_frames(command, sequence);
  group("Messages");
  add_reports(command, a);
  group(kMoreOptions);
  add_more_sequence(command, frames, sequence, a);
  add_more_files(command, a);
  add_run(command, a);
  add_more_reports(command, a);
}

}  // namespace

void add_fuse(CLI::App& app) {
  auto arguments = std::make_shared<FuseArguments>();
  auto sequence = std::make_shared<SequenceArguments>();
  CLI::App* command = app.add_subcommand("fuse", "Fuses an LRHS and an HRLS render, or sequences of them");
  add_options(*command, *arguments, *sequence);
  command->footer(
      "In what is read, NaN counts as 0 and infinities as +-65504; a warning says how many there were.\n\n"
      "Examples:\n"
      "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr --preview fused.png\n"
      "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr --model x4-fast --reference truth.exr\n"
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
