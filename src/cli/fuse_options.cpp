#include <array>
#include <cmath>

#include "cli/common/commands.h"
#include "cli/common/help.h"
#include "cli/common/precisions.h"
#include "cli/fuse/choice.h"
#include "cli/fuse/fuse_parse.h"
#include "cli/sequence/sequence.h"

namespace raymeld::cli {
namespace {

std::string finite(const std::string& text) {
  return std::isfinite(std::strtof(text.c_str(), nullptr)) ? "" : text + " is not finite";
}

// Adds an option whose value is `parse` of its text. An Error of `parse` means that the text is not valid.
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

// Adds an option that takes one of the names in `values`; the first is the default.
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

// Adds options of earlier versions, which only say what to use instead.
void add_removed(CLI::App& command) {
  constexpr std::array<std::pair<const char*, const char*>, 2> kRemoved{
      {{"--adaptive", "was removed, as it rarely saved time; --quality fast takes a faster model"},
       {"--target-psnr", "was removed, as the estimate was off by 1 dB; --quality chooses the model"}}};
  for (const auto& [name, reason] : kRemoved) {
    const auto refuse = [name = name, reason = reason](const std::string&) {
      throw CLI::ValidationError(name, reason);
    };
    command.add_option_function<std::string>(name, refuse)->expected(0, 1)->group("");
  }
}

void add_files(CLI::App& command, Task of, FuseArguments& a) {
  if (of != Task::kDenoise) {
    command
        .add_option("--lrhs", a.lrhs, "Reads the small, many-sample render from this OpenEXR file (required)")
        ->type_name("FILE");
  }
  if (of != Task::kUpscale) {
    command
        .add_option(
            "--hrls", a.hrls,
            "Reads the full-size, few-sample render and its guide layers from this OpenEXR file (required)")
        ->type_name("FILE");
  }
  command
      .add_option("-o,--output", a.output,
                  of == Task::kUpscale
                      ? "Writes the result to this OpenEXR file; attributes are those of LRHS, "
                        "and windows are the scale times its own"
                      : "Writes the result to this OpenEXR file; windows and attributes are "
                        "those of HRLS")
      ->type_name("FILE")
      ->check(ends_in(".exr", "; --preview writes a PNG"));
  command.add_option("--preview", a.preview, "Writes the result as an sRGB PNG too")
      ->type_name("FILE")
      ->check(ends_in(".png"));
  command
      .add_option(
          "--map", a.map,
          "Maps channels to layers: a preset (generic, cycles, arnold, pbrt, renderman), LAYER=PREFIX, "
          "LAYER=CHANNEL,CHANNEL,CHANNEL, viewlayer=NAME, view=NAME, motion=PREFIX, "
          "motion=CHANNEL,CHANNEL, motion-factors=X,Y or depth=CHANNEL; may be repeated")
      ->type_name("ITEM")
      ->allow_extra_args(false);
}

// Adds an option for the samples a pixel of a render.
void add_samples(CLI::App& command, const std::string& name, float& count, const char* render) {
  command
      .add_option(name, count,
                  fmt::format("Says how many samples a pixel of {} has, for models that know it; Cycles "
                              "writes it into its files",
                              render))
      ->check(CLI::PositiveNumber)
      ->type_name("N");
}

void add_lrhs_sampling(CLI::App& command, Task of, FuseArguments& a) {
  const char* automatic = of == Task::kFuse
                              ? "found from the file's attributes, else from the pixels of both files"
                              : "as the file's attributes say, else centered";
  command
      .add_option(
          "--lrhs-sampling", a.sampling,
          fmt::format(
              "Sets how LRHS was sampled: centered (an ordinary small render), nearest (every scale-th "
              "pixel of a full render, as degrade makes it) or auto ({})",
              automatic))
      ->check(CLI::IsMember({"auto", "nearest", "centered"}))
      ->capture_default_str();
}

// Adds the options about how LRHS goes with HRLS.
void add_pair(CLI::App& command, FuseArguments& a) {
  command
      .add_option("--map-lrhs", a.lrhs_map, "Maps channels to layers, as --map does, in the LRHS file alone")
      ->type_name("ITEM")
      ->allow_extra_args(false);
  add_lrhs_sampling(command, Task::kFuse, a);
  add_samples(command, "--lrhs-spp", a.samples.lrhs, "LRHS");
  add_named<PairCheck>(
      command, "--pair-check", a.pair_check,
      {{"refuse", PairCheck::kRefuse}, {"warn", PairCheck::kWarn}, {"off", PairCheck::kOff}},
      "Refuses files that show different things, warns of them, or does not check; refuse and warn also "
      "make LRHS as bright as HRLS");
}

// Adds the options about HRLS.
void add_hrls(CLI::App& command, FuseArguments& a) {
  command
      .add_option(
          "--guides", a.guides,
          "Reads albedo and normal from this OpenEXR file instead of HRLS: a render as large as HRLS, "
          "with more samples")
      ->type_name("FILE");
  add_samples(command, "--hrls-spp", a.samples.hrls, "HRLS");
  command.add_flag("--keep-layers", a.keep_layers,
                   "Copies all HRLS channels that are not computed to the output, bit by bit");
}

void add_more_files(CLI::App& command, Task of, FuseArguments& a) {
  if (of == Task::kFuse) add_pair(command, a);
  of == Task::kUpscale ? add_lrhs_sampling(command, of, a) : add_hrls(command, a);
  add_parsed(
      command, "--window", a.window, parse_window,
      "Computes and writes only this part of the whole result, in its pixel coordinates; the part is as in "
      "the whole frame, and takes about as long as a frame of this size")
      ->type_name("X,Y,W,H");
  command
      .add_option("--output-type", a.output_type,
                  fmt::format("Writes channels of this type; auto is the type of {}'s color",
                              of == Task::kUpscale ? "LRHS" : "HRLS"))
      ->check(CLI::IsMember({"auto", "half", "float"}))
      ->capture_default_str();
  command.add_flag("--layers", a.layers,
                   "Also writes the diffuse, specular and other (emission) light of the result, which "
                   "add up to it; the inputs need diffuse and specular, and it takes four times as long");
  command
      .add_option("--preview-before-after", a.before_after,
                  "Writes a PNG with the inputs, LRHS by bicubic interpolation, the result and, if "
                  "given, the reference side by side")
      ->type_name("FILE")
      ->check(ends_in(".png"));
  command.add_option("--exposure", a.exposure_stops, "Brightens the previews by this many stops")
      ->type_name("STOPS")
      ->check(finite);
}

// Adds the options that choose the model by name, quality or time.
void add_model(CLI::App& command, Task of, FuseArguments& a) {
  if (of == Task::kUpscale) {
    command
        .add_option(
            "--scale", a.scale,
            fmt::format("Makes the result this many times as wide and as high as LRHS; by default {}, "
                        "or what the model of --model does",
                        kUpscaledBy))
        ->check(CLI::IsMember({2, 4, 8}));
  }
  const char* description = of == Task::kFuse
                                ? "Uses this model: a name, a scale such as x4, or a file; without it the "
                                  "scale follows from the sizes of the images"
                                : "Uses this model: a name or a file";
  CLI::Option* model = command.add_option("--model", a.model, description)->type_name("MODEL");
  CLI::Option* quality =
      add_parsed(
          command, "--quality", a.request, parse_quality,
          "Chooses the model: high, balanced (the default), fast, or a number N from 0, the fastest, to "
          "100, the best; in between, twice the time must bring at least (100 - N) / N * 0.1 dB")
          ->type_name("high|balanced|fast|N")
          ->excludes(model);
  add_parsed(command, "--budget", a.request, parse_budget,
             "Chooses the best model that computes a frame in this time, such as 16ms or 2s, without reading "
             "and writing files; measures the models at this size, once on each device")
      ->type_name("TIME")
      ->group(kMoreOptions)
      ->excludes(model)
      ->excludes(quality);
}

void add_run(CLI::App& command, FuseArguments& a) {
  command
      .add_option("--device", a.device,
                  "Runs on this Vulkan device: its index in raymeld devices, its UUID or part of its name")
      ->type_name("DEVICE");
  add_named<Precision>(
      command, "--precision", a.precision,
      {{"auto", Precision::kAuto}, {"fp32", Precision::kFp32}, {"fp16", Precision::kFp16}},
      "Computes in fp32 or in fp16 (activations and weights in 16 bits, sums in 32); auto is fp16 on a "
      "GPU that supports it, with fp32 for tiles whose values 16 bits cannot hold, unless with --temporal");
  add_named<Overflow>(
      command, "--overflow", a.overflow,
      {{"error", Overflow::kError}, {"warn", Overflow::kWarn}, {"redo", Overflow::kRedo}},
      "Handles values that --precision fp16 cannot hold: fails with an error, warns with their number, or "
      "computes their tiles again in fp32, as --precision auto does");
  add_named<KernelChoice>(
      command, "--kernels", a.kernels, {{"auto", KernelChoice::kAuto}, {"direct", KernelChoice::kDirect}},
      "Computes with the fastest kernels, which raymeld tune measures (else with default ones), or with "
      "direct ones, which are plain sums and give the same bits for any tiles");
  command
      .add_option("--max-memory", a.max_memory_mib,
                  "Limits the device memory to this many MiB; larger frames are cut into tiles")
      ->type_name("MIB")
      ->check(CLI::Range(uint64_t{1}, uint64_t{1} << 40));
  add_parsed(
      command, "--input-exposure", a.input_exposure, parse_exposure,
      "Multiplies the network's input radiance by this factor and divides its output by it: a number, off "
      "(1), or auto (found from LRHS, or from HRLS where there is none, for models that were trained at one "
      "brightness, else 1)")
      ->type_name("auto|off|FACTOR")
      ->default_str("auto");
}

void add_reports(CLI::App& command, FuseArguments& a) {
  command.add_flag("--dry-run", a.dry_run, "Shows the layers, the plan and its memory; writes nothing");
  CLI::Option* quiet =
      command.add_flag("--quiet", a.quiet, "Prints only warnings and errors, and no progress");
  command.add_flag("--verbose", a.verbose, "Also prints the channels that each layer is read from")
      ->excludes(quiet);
  command.add_flag("--json", a.json, "Prints one JSON object; if the command fails, one with an error");
}

void add_more_reports(CLI::App& command, FuseArguments& a) {
  command.add_option("--reference", a.reference, "Measures the result against this OpenEXR file")
      ->type_name("FILE");
  command
      .add_flag("--profile", a.profile,
                "Shows the time of each layer; the frame runs twice, and the second run is measured")
      ->excludes("--skip-unchanged")
      ->excludes("--changed-only");
  command.add_option("--dump", a.dump, "Writes each layer's output as a NumPy file to this folder")
      ->type_name("DIR")
      ->excludes("--skip-unchanged")
      ->excludes("--changed-only");
}

CLI::Option* add_frames(CLI::App& command, SequenceArguments& a) {
  return add_parsed(
             command, "--frames", a.frames, parse_frames,
             "Takes a sequence of frames, such as 1-240, 1-240x2 or 1-10,15. In each file name the last run "
             "of # stands for the frame's number, padded to the run's length; an input that all frames share "
             "may have none")
      ->type_name("RANGES");
}

// Adds the options for frames that are joined in time.
void add_temporal(CLI::App& command, CLI::Option* frames, SequenceArguments& a, FuseArguments& frame) {
  CLI::Option* temporal =
      command
          .add_flag(
              "--temporal", frame.temporal,
              "Joins each frame with the ones before it, along the motion vectors of HRLS: less noise and "
              "less flicker; starts anew where a frame is missing or shows something else")
          ->needs(frames);
  add_parsed(command, "--reset-at", a.reset_at, parse_frames,
             "Makes these frames of --frames start anew, as the first of a shot")
      ->type_name("RANGES")
      ->needs(temporal);
  command.add_flag("--still", frame.still, "Says that nothing moves, so that no motion vectors are needed")
      ->needs(temporal);
}

// Throws CLI::ExcludesError for options that do not go with --temporal.
void check_temporal(const FuseArguments& a) {
  if (!a.temporal) return;
  for (const auto& [name, given] : {std::pair("--window", a.window.has_value()),
                                    {"--skip-unchanged", a.skip_unchanged},
                                    {"--profile", a.profile},
                                    {"--overflow redo", a.overflow == Overflow::kRedo}})
    if (given) throw CLI::ExcludesError("--temporal", name);
}

void add_more_sequence(CLI::App& command, Task of, CLI::Option* frames, SequenceArguments& a,
                       FuseArguments& frame) {
  add_parsed(command, "--shard", a.shard, parse_shard,
             "Takes part I of N of the sequence: every N-th frame, from the I-th on, or frames that follow "
             "each other with --temporal")
      ->type_name("I/N")
      ->needs(frames);
  command
      .add_flag(
          "--resume", a.resume,
          "Skips frames whose outputs all exist and are no older than the inputs and the file of --model")
      ->needs(frames);
  command
      .add_flag("--skip-unchanged", frame.skip_unchanged,
                "Computes only the tiles that depend on pixels that changed since the last frame, and copies "
                "the others from its output; computes all tiles if the exposure differs, so give "
                "--input-exposure a factor or off")
      ->needs(frames);
  if (of != Task::kUpscale) add_temporal(command, frames, a, frame);
  // This is the option's name in earlier versions.
  command.add_flag("--changed-only", frame.skip_unchanged)->needs(frames)->group("");
}

// Each option goes to the group that is set when it is added.
void add_options(CLI::App& command, Task of, FuseArguments& a, SequenceArguments& sequence) {
  const auto group = [&](const char* name) { command.option_defaults()->group(name); };
  group("Files");
  add_files(command, of, a);
  add_removed(command);
  group("Model and sequence");
  add_model(command, of, a);
  CLI::Option* frames = add_frames(command, sequence);
  group("Messages");
  add_reports(command, a);
  group(kMoreOptions);
  add_more_sequence(command, of, frames, sequence, a);
  add_more_files(command, of, a);
  add_run(command, a);
  add_more_reports(command, a);
}

// Throws CLI::RequiredError unless the files are given that a command reads.
void check_files(Task of, const FuseArguments& arguments) {
  const auto require = [&](const std::string& file, const char* name, const std::string& hint) {
    if (file.empty()) throw CLI::RequiredError(name + (" is required" + hint), CLI::ExitCodes::RequiredError);
  };
  const bool both = of == Task::kFuse;
  if (of != Task::kDenoise)
    require(arguments.lrhs, "--lrhs",
            both && !arguments.hrls.empty() ? "; raymeld denoise takes --hrls alone" : "");
  if (of != Task::kUpscale)
    require(arguments.hrls, "--hrls", both ? "; raymeld upscale takes --lrhs alone" : "");
}

// Adds a command that makes an image of one render or two.
CLI::App* add_command(CLI::App& app, Task of, const char* name, const char* description) {
  auto arguments = std::make_shared<FuseArguments>();
  auto sequence = std::make_shared<SequenceArguments>();
  CLI::App* command = app.add_subcommand(name, description);
  add_options(*command, of, *arguments, *sequence);
  command->callback([of, arguments, sequence] {
    check_files(of, *arguments);
    check_temporal(*arguments);
    if (arguments->output.empty() && !arguments->dry_run) throw CLI::RequiredError("--output");
    if (!sequence->frames.empty()) return run_sequence(*sequence, *arguments);
    check_no_patterns(*arguments);
    run_fuse(*arguments);
  });
  return command;
}

constexpr const char* kNotFinite =
    "NaN in the inputs is read as 0 and infinities as +-65504; a warning gives their number.\n\n";

}  // namespace

void add_fuse(CLI::App& app) {
  add_command(app, Task::kFuse, "fuse", "Fuses an LRHS and an HRLS render, or sequences of them")
      ->footer(
          std::string(kNotFinite) +
          "Examples:\n"
          "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr --preview fused.png\n"
          "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr --model x4-fast --reference truth.exr\n"
          "  raymeld fuse --lrhs low.exr --hrls high.exr --map cycles --map albedo=ViewLayer.DiffCol "
          "--dry-run\n"
          "  raymeld fuse --lrhs low.####.exr --hrls high.####.exr -o fused.####.exr --frames 1-240 "
          "--resume");
}

void add_denoise(CLI::App& app) {
  add_command(app, Task::kDenoise, "denoise", "Denoises an HRLS render, or a sequence of them, without LRHS")
      ->footer(std::string(kNotFinite) +
               "Examples:\n"
               "  raymeld denoise --hrls render.exr -o denoised.exr --preview denoised.png\n"
               "  raymeld denoise --hrls render.####.exr -o denoised.####.exr --frames 1-240 --resume");
}

void add_upscale(CLI::App& app) {
  add_command(app, Task::kUpscale, "upscale", "Upscales an LRHS render, or a sequence of them, without HRLS")
      ->footer(std::string(kNotFinite) +
               "Examples:\n"
               "  raymeld upscale --lrhs small.exr -o large.exr --preview large.png\n"
               "  raymeld upscale --lrhs small.####.exr -o large.####.exr --scale 4 --frames 1-240 --resume");
}

}  // namespace raymeld::cli
