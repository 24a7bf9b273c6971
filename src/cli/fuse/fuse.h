// The parts of the command `fuse`, in the order in which it runs them. A frame is opened, read, fused and
// written; a sequence (sequence.h) does these steps in threads, and nothing else.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/common/canvas.h"
#include "cli/common/console.h"
#include "cli/common/models.h"
#include "cli/common/outputs.h"
#include "cli/common/quality.h"
#include "fusion/fuser.h"
#include "io/layers_from_exr.h"
#include "fusion/pair.h"

namespace raymeld::cli {

// What becomes of a frame with values that --precision fp16 cannot hold.
enum class Overflow { kError, kWarn, kRedo };

// What becomes of a frame whose LRHS and HRLS do not belong together.
enum class PairCheck { kRefuse, kWarn, kOff };

// What a model is to be chosen by: see choice.h.
struct Wish {
  enum class Kind { kLevel, kBudget, kTarget };
  Kind kind = Kind::kLevel;
  double value = 0;  // from 0 to 100; ms a frame; PSNR in dB
};

struct Choice {
  std::string wish, model;
  std::optional<double> time_ms;      // of a frame, where it was measured on the device
  double loss_db = 0;                 // of PSNR, against the best model
  std::optional<double> probability;  // that a target is reached
  double estimate_db = 0, error_db = 0;
};

// Of one frame, or of a sequence: then some of the paths are patterns.
struct FuseArguments {
  std::string lrhs, hrls, output, model, device, reference, preview, before_after, dump;
  Precision precision = Precision::kAuto;
  Overflow overflow = Overflow::kError;
  PairCheck pair_check = PairCheck::kRefuse;
  KernelChoice kernels = KernelChoice::kAuto;
  std::string sampling = "auto", output_type = "auto";
  std::vector<std::string> map, lrhs_map;
  float exposure_stops = 0;
  float input_exposure = 0;  // 0: what the model asks for
  uint64_t max_memory_mib = 0;
  std::optional<Wish> wish = {};
  std::optional<Choice> choice = {};        // of `model`, where there was a wish
  std::optional<Imath::Box2i> window = {};  // what is fused, in HRLS's pixels; none: its data window
  bool changed_only = false;                // since the last frame of a sequence
  bool keep_layers = false, profile = false, dry_run = false, json = false, quiet = false, verbose = false;

  std::vector<std::filesystem::path> inputs() const;
  // Without the folder of --dump.
  std::vector<std::filesystem::path> outputs() const;
  std::filesystem::path dump_folder() const;  // without a last slash
  std::filesystem::path last_dumped() const;  // the file in it that is written last
  // Whether what was fused is measured against, or shown beside, the images it was made of.
  bool compares() const { return !reference.empty() || !before_after.empty(); }
  bool notes() const { return !quiet && !json; }

  void take(const Choice& chosen) {
    model = chosen.model;
    choice = chosen;
  }
};

// Who says where LRHS samples lie. Where neither an option nor the file does, the pixels of both files show
// it, or do not: then LRHS is taken for an ordinary small render.
enum class PhaseSource { kOption, kFile, kPair, kDefault };

// The files, open, with all that can be known before their pixels are read.
struct FuseFiles {
  ExrFile lrhs, hrls;
  LayerMap lrhs_map, hrls_map;
  Windows lrhs_windows, hrls_windows;  // of the colour's part
  std::shared_ptr<const Model> model;
  Canvas frame, canvas;          // all that HRLS takes; what is fused of it: the window and a halo
  Imath::Box2i window;           // of the output, within HRLS's data window
  ConstantLayers absent_layers;  // that the model takes and does without
  float phase = 0;               // of LRHS samples; see FuserOptions; examine() finds what is not said
  PhaseSource phase_source = PhaseSource::kDefault;
  PairFindings pair;  // by examine()
  std::optional<ExrFile> reference;
  LayerMap reference_map;

  const ExrChannel& hrls_color() const { return hrls.channel(hrls_map.layers.at("color").terms[0][0]); }
};

struct FuseImages {
  Image lrhs, hrls;                   // of the canvas: (3, h, w) and (K, s h, s w), all finite
  ConstantLayers constants;           // of HRLS, that `hrls` does not hold; absent ones too
  float exposure = 1;                 // of the whole frame, see FuserOptions
  std::optional<Image> reference;     // (3, H, W) of the window
  std::vector<ExrRawChannel> passed;  // of passed_channels(), as they are
};

struct FuseResult {
  Image fused;  // (3, H, W) of the window
  FuseReport report;
  double time_ms = 0;  // of Fuser::fuse(), which a budget is for
  Tiling tiling;
  uint64_t allocated_bytes = 0;
  Storage storage = Storage::kFloat32;  // 32 bits too where every tile was computed again in them
};

// A part of the work on a frame and how long it took.
struct Phase {
  const char* name;
  double time_ms;
};

// A frame on its way, as far as it is. One thread at a time may have it.
struct FuseFrame {
  FuseArguments arguments;  // without patterns
  Console console;
  FuseFiles files;
  FuseImages images;
  FuseResult result;
  StagedFiles staged;
  std::vector<Phase> phases = {};  // those that are over, in their order

  // Drops the inputs, often the largest part of a frame's memory, unless outputs show them.
  void drop_inputs() {
    if (!arguments.compares()) images.hrls = {};
  }
};

// The command for one frame. Throws Error and Cancelled; then no output is left behind.
void run_fuse(const FuseArguments& arguments);

// Throws Error when a file, a layer or a model is missing, or sizes or windows do not fit.
FuseFiles open_files(const FuseArguments& arguments, LastModel& models);

// The channels of HRLS that the output holds as they are: alpha, or all but the colour.
std::vector<std::string> passed_channels(const FuseFiles& files, bool keep_layers);

// The frame's (3, h, w), all finite.
Image load_lrhs(FuseFiles& files, Console& console);

// Whether a layer has little noise however few the samples are.
inline bool is_guide(const std::string& layer) { return layer == "albedo" || layer == "normal"; }

// Finds from the whole frame's pixels what nobody says of them: where LRHS samples lie and how bright LRHS
// is, which it makes as bright as HRLS. Warns of a pair that hardly belongs together. Throws Error where it
// cannot.
// `layers`: what `hrls` holds, color first.
void examine(const FuseArguments& arguments, FuseFiles& files, Image& lrhs, const Image& hrls,
             std::span<const std::string> layers, Console& console);

struct ColorPair {
  Image lrhs, hrls;
};
// Reads the whole frame's colors, (3, h, w) and (3 or more, s h, s w), all finite, and examines them.
ColorPair load_colors(const FuseArguments& arguments, FuseFiles& files, Console& console);

// What radiance is multiplied by for the network, with the frame's LRHS.
float exposure_for(const FuseArguments& arguments, const Model& model, const Image& lrhs);

// open_files(), and asks whether the outputs can be written. Throws Error.
std::unique_ptr<FuseFrame> open_frame(const FuseArguments& arguments, Console console, LastModel& models);

// All that is read of the files, so that what becomes of them while the frame is fused makes no difference.
// Throws Error.
void load_frame(FuseFrame& frame);

FuserOptions fuser_options(const FuseArguments& arguments, const FuseFiles& files, const Device& device,
                           const ConstantLayers& constants);

const char* precision_name(Storage storage);

// What --dry-run shows of a frame. Throws Error.
std::string plan_text(const FuseArguments& arguments, FuseFiles& files, const Device& device,
                      Console& console);
nlohmann::ordered_json plan_json(const FuseArguments& arguments, FuseFiles& files, const Device& device,
                                 Console& console);

// Adds a phase to a frame at the end of a scope.
class PhaseTimer {
 public:
  PhaseTimer(FuseFrame& frame, const char* name) : frame_(frame), name_(name) {}
  ~PhaseTimer() { frame_.phases.push_back({name_, watch_.ms()}); }
  PhaseTimer(const PhaseTimer&) = delete;
  PhaseTimer& operator=(const PhaseTimer&) = delete;

 private:
  FuseFrame& frame_;
  const char* name_;
  Stopwatch watch_;
};

// Fuses frames one after another. What was made for a frame serves the next ones for as long as their model,
// size and sampling are the same; each comes out as if it were the only one.
class FrameFuser {
 public:
  // `device` must outlive this.
  explicit FrameFuser(const Device& device);
  ~FrameFuser();

  // Begins to compile, in a thread of its own, what the frame is likely to take by all that is known before
  // its pixels are read. Says so where the device has no kernels on disk yet.
  void prepare(const FuseFrame& frame);

  // All frames must have the same options. Stages what --dump asks for. Throws Error, and Cancelled when
  // `progress` says so; then the next frame may still work.
  void fuse(FuseFrame& frame, const Progress& progress);

 private:
  struct Made;
  struct Preparation;
  Made& made_for(FuseFrame& frame);

  const Device& device_;
  std::unique_ptr<Preparation> preparation_;
  std::unique_ptr<Made> made_;
};

// Stages all that is to be written, the image itself last, and measures it where there is a reference.
// Throws Error and Cancelled.
QualityTable stage_outputs(FuseFrame& frame);

}  // namespace raymeld::cli
