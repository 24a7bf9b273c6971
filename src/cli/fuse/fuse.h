// Declares the parts of the commands `fuse`, `denoise` and `upscale`, in the order in which they run them. A
// frame is opened, read, fused and written; a sequence (sequence.h) runs these same steps in threads.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/common/canvas.h"
#include "cli/common/console.h"
#include "cli/common/models.h"
#include "cli/common/outputs.h"
#include "cli/common/quality.h"
#include "fusion/cut_finder.h"
#include "fusion/fuser.h"
#include "fusion/pair.h"
#include "io/layers_from_exr.h"

namespace raymeld::cli {

// Selects what happens to a frame with values that --precision fp16 cannot hold.
enum class Overflow { kError, kWarn, kRedo };

// Selects what happens to a frame whose LRHS and HRLS do not belong together.
enum class PairCheck { kRefuse, kWarn, kOff };

// Holds the quality or time that a model is chosen by; see choice.h.
struct ModelRequest {
  enum class Kind { kLevel, kBudget };
  Kind kind = Kind::kLevel;
  double value = 0;  // level from 0 to 100, or ms a frame
};

struct Choice {
  std::string request, model;
  std::optional<double> time_ms;  // time of a frame, if measured on the device
  double loss_db = 0;             // PSNR below that of the best model
};

// Holds the options for one frame, or for a sequence, of which some paths are patterns. To denoise a frame is
// to fuse it without LRHS: `lrhs` is empty, and HRLS stands for it at a scale of 1. To upscale a frame is to
// fuse it without HRLS: `hrls` is empty.
struct FuseArguments {
  std::string lrhs, hrls, guides, output, model, device, reference, preview, before_after, dump;
  Precision precision = Precision::kAuto;
  Overflow overflow = Overflow::kError;
  PairCheck pair_check = PairCheck::kRefuse;
  KernelChoice kernels = KernelChoice::kAuto;
  std::string sampling = "auto", output_type = "auto";
  std::vector<std::string> map, lrhs_map;
  SampleCounts samples = {};  // 0: as the files say
  int scale = 0;              // what LRHS alone is upscaled by; 0: the model's, or kUpscaledBy
  float exposure_stops = 0;
  float input_exposure = 0;  // 0: the exposure that the model asks for
  uint64_t max_memory_mib = 0;
  std::optional<ModelRequest> request = {};
  std::optional<Choice> choice = {};        // the choice of `model`, if no name was given
  std::optional<Imath::Box2i> window = {};  // the part to write, in full-size pixels; none: all
  bool skip_unchanged = false;              // compute only changes since a sequence's last frame
  bool temporal = false;                    // join each frame of a sequence with the ones before it
  bool still = false;                       // with `temporal`, nothing moves
  bool layers = false;                      // also write the parts of the light
  bool keep_layers = false, profile = false, dry_run = false, json = false, quiet = false, verbose = false;

  std::vector<std::filesystem::path> inputs() const;
  // Leaves out the folder of --dump.
  std::vector<std::filesystem::path> outputs() const;
  std::filesystem::path dump_folder() const;  // has no slash at its end
  std::filesystem::path last_dumped() const;  // the file in that folder that is written last
  Task task() const { return lrhs.empty() ? Task::kDenoise : hrls.empty() ? Task::kUpscale : Task::kFuse; }
  // Returns whether the inputs are measured or shown beside the fused image.
  bool compares() const { return !reference.empty() || !before_after.empty(); }
  bool notes() const { return !quiet && !json; }

  void take(const Choice& chosen) {
    model = chosen.model;
    choice = chosen;
  }
};

inline constexpr int kUpscaledBy = 2;

// Names the source of the phase of LRHS samples. If neither an option nor the file gives it, it is found from
// the pixels of both files; if these do not show it, LRHS is taken for an ordinary small render.
enum class PhaseSource { kOption, kFile, kPair, kDefault };

// Holds the open files and all that is known before their pixels are read. Where the model reads one render,
// `lrhs` and `hrls` are one file, opened twice.
struct FuseFiles {
  ExrFile lrhs, hrls;  // `hrls` gives the output its attributes
  LayerMap lrhs_map, hrls_map;
  Windows lrhs_windows, hrls_windows;  // windows of the parts that hold the color, and of the output
  std::shared_ptr<const Model> model;
  Canvas frame;                  // the whole frame as the files have it
  Canvas canvas;                 // the part that is fused at the model's scale: the window and a halo
  Imath::Box2i window;           // the output's window, within HRLS's data window
  ConstantLayers absent_layers;  // layers that the model takes and HRLS lacks
  float phase = 0;               // LRHS's own; examine() finds it if neither option nor file gives it
  PhaseSource phase_source = PhaseSource::kDefault;
  SampleCounts samples;  // the files' own; 0 where neither an option nor the file gives a count
  PairFindings pair;     // set by examine()
  std::optional<ExrFile> reference;
  LayerMap reference_map;
  std::optional<ExrFile> guides;   // a render of HRLS's guides with more samples
  LayerMap guides_map;             // only layers that are taken from there
  bool computes_variance = false;  // the device computes the variance, of frames that are joined

  bool reads_lrhs() const { return model->architecture().reads_lrhs(); }
  bool reads_hrls() const { return model->architecture().reads_hrls(); }
  bool reads_both() const { return reads_lrhs() && reads_hrls(); }
  const char* pixels() const { return reads_lrhs() ? "LRHS pixels" : "pixels"; }  // what tiles are counted in
  // Returns the factor by which LRHS is upsampled for the model: an x4 model fuses an LRHS of x8 too.
  int upsampling() const { return frame.scale / canvas.scale; }
  // These are FuserOptions::phase and samples, those of the LRHS that the model reads.
  float model_phase() const { return upsampling() == 1 ? phase : lrhs_phase(true, uint32_t(canvas.scale)); }
  SampleCounts model_samples() const {
    return {samples.lrhs / float(upsampling() * upsampling()), samples.hrls};
  }

  // Lists the layers that the image of HRLS holds if these are constant.
  std::vector<std::string> layers_without(const ConstantLayers& constants) const {
    return image_layers(model->architecture(), constants, computes_variance);
  }

  const ExrChannel& hrls_color() const { return hrls.channel(hrls_map.layers.at("color").terms[0][0]); }
};

inline const std::string kAlpha = "alpha";
// These are the parts of the light that --layers writes, and the layers that both files must have for them.
inline const std::array<std::string, 3> kLightParts = {"diffuse", "specular", "emission"};
inline const std::vector<std::string> kSplitLight = {"diffuse", "specular"};

// Holds an image that is fused as the color is, with the same guides: alpha, in three equal channels, or one
// of kLightParts. Emission is all light that is neither diffuse nor specular.
struct Companion {
  std::string name;
  size_t sequence;   // see Fuser::fuse(); the color's is 0
  Image lrhs, hrls;  // (3, h, w) and (3, s h, s w) of the canvas; `hrls` is empty where LRHS is upscaled
};

// Holds the inputs as the user sees them beside the fused image, (3, H, W) of the window; `bicubic` is LRHS.
// An input that the model does not read is empty.
struct ShownInputs {
  Image bicubic, hrls;
};

struct FuseImages {
  Image lrhs, hrls;                   // the canvas: (3, h, w) and (K, s h, s w) or empty, all finite
  Image motion;                       // (4, s h, s w) of the canvas, see Fuser::fuse(); empty unless temporal
  ShownInputs shown;                  // empty unless the fused image is compared with them
  ConstantLayers constants;           // constant and absent layers, which `hrls` does not hold
  float exposure = 1;                 // the whole frame's exposure, see FuserOptions
  std::optional<Image> reference;     // (3, H, W) of the window
  std::vector<ExrRawChannel> passed;  // the channels of passed_channels(), unchanged
  std::vector<Companion> companions;
};

struct FuseResult {
  Image fused;                              // (3, H, W) of the window
  std::map<std::string, Image> companions;  // each (3, H, W); alpha counts in the first channel only
  FuseReport report;
  double time_ms = 0;  // time of Fuser::fuse(), companions included, which --budget limits
  Tiling tiling;
  uint64_t allocated_bytes = 0;
  Storage storage = Storage::kFloat32;  // 32 bits also if every tile was computed again in them
};

// Holds the time of one part of the work on a frame.
struct Phase {
  const char* name;
  double time_ms;
};

// Says how a frame goes on with the one before it, where frames are joined in time.
struct FrameInTime {
  int number = 0;           // the frame goes on with the one whose number is one less
  bool starts_anew = true;  // it goes on with none
  bool is_lead_in = false;  // it is not fused, but later ones go on with it
  bool next_is_fused = true;
};

// Holds a frame and the results of the steps that it has passed. One thread at a time may use it.
struct FuseFrame {
  FuseArguments arguments;  // paths are no patterns
  Console console;
  FuseFiles files;
  FuseImages images;
  FuseResult result;
  StagedFiles staged;
  std::vector<Phase> phases = {};  // finished phases, in their order
  FrameInTime time = {};

  // Drops what only the network reads, often the largest part of a frame's memory.
  void drop_inputs() { images.lrhs = images.hrls = images.motion = {}; }
};

// Runs the command for one frame. Throws Error and Cancelled, and then leaves no output behind.
void run_fuse(const FuseArguments& arguments);

// Opens the files. Throws Error when a file, a layer or a model is missing, or sizes or windows do not fit.
FuseFiles open_files(const FuseArguments& arguments, LastModel& models);

// Returns the channels of HRLS that may be copied to the output: alpha, or with --keep-layers all but those
// that are fused.
std::vector<std::string> passed_channels(const FuseFiles& files, const FuseArguments& arguments);

// Returns the name of the output's channel for red (0), green or blue light of one of kLightParts.
std::string light_channel(const std::string& part, int c);

// Takes HRLS's alpha as a companion if LRHS has one too, and returns whether it did. An alpha that is the
// same everywhere is to be copied. Throws Error.
bool load_alpha(FuseFrame& frame, const ExrRawChannel& of_hrls);

// Takes LRHS's alpha as a companion where LRHS is upscaled. One that is the same everywhere is so in the
// output. Throws Error.
void load_lrhs_alpha(FuseFrame& frame);

// Reads the parts of the light as companions, after the color. Throws Error.
void load_light(FuseFrame& frame);

// Returns how often the network will run for a frame, judged by alpha's pixels and the options. Throws Error.
int count_runs(FuseFiles& files, const FuseArguments& arguments);

// Fuses a companion's LRHS and an HRLS of image_layers() with a factor of radiance.
using FuseOne = std::function<Image(const Companion& companion, const Image& hrls, float exposure)>;
// Fuses the companions of a frame whose color is fused. The parts of the light add up to the color.
void fuse_companions(FuseFrame& frame, const FuseOne& fuse);

// Returns the canvas's part of an LRHS image that covers `from`, upsampled to the model's scale.
Image for_canvas(const FuseFiles& files, Image lrhs, const Imath::Box2i& from);

// Replaces values of a part of LRHS that are not finite, and warns of them unless HRLS stands for it.
void sanitize_lrhs(Image& lrhs, const FuseFiles& files, Console& console);

// Reads the whole frame's LRHS, (3, h, w), all finite.
Image load_lrhs(FuseFiles& files, Console& console);

// Returns whether a layer has little noise even when samples are few.
inline bool is_guide(const std::string& layer) { return layer == "albedo" || layer == "normal"; }

// Reads layers of the whole of HRLS, (3 layers, H, W), all finite; guides come from their own file, if given.
Image load_hrls(FuseFiles& files, std::span<const std::string> layers, Console& console);

// Finds from the whole frame's pixels where LRHS samples lie, unless that is given, and how bright LRHS is,
// and makes LRHS as bright as HRLS. Warns of a pair that hardly belongs together, and throws Error for one
// that does not, as far as --pair-check says so. `layers` are the layers in `hrls`, color first.
void examine(const FuseArguments& arguments, FuseFiles& files, Image& lrhs, const Image& hrls,
             std::span<const std::string> layers, Console& console);

// Makes LRHS as bright as HRLS, as examine() found.
void match_brightness(const FuseFiles& files, Image& lrhs);

struct ColorPair {
  Image lrhs, hrls;
};
// Reads the whole frame's colors, (3, h, w) and (3 or more, s h, s w), all finite, and examines them.
ColorPair load_colors(const FuseArguments& arguments, FuseFiles& files, Console& console);

// Returns the factor that radiance is multiplied by for the network; `lrhs` is the whole frame's.
float exposure_for(const FuseArguments& arguments, const Model& model, const Image& lrhs);

// Calls open_files() and checks that the outputs can be written. Throws Error.
std::unique_ptr<FuseFrame> open_frame(const FuseArguments& arguments, Console console, LastModel& models);

// Reads all that is needed of the files, so that changing them while the frame is fused makes no difference.
// Throws Error.
void load_frame(FuseFrame& frame);

// Throws Error unless a model joins frames in time, with an ordinary small render as LRHS.
void check_keeps_history(const Model& model);

// Returns whether a frame that is read shows something else than the last one that `cuts` was given.
bool is_cut(const FuseFrame& frame, CutFinder& cuts);

FuserOptions options_of(const FuseArguments& arguments, const FuseFiles& files, const Device& device,
                        const ConstantLayers& constants);

const char* precision_name(Storage storage);

// These return the plan of a frame that --dry-run shows. They throw Error.
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

// Fuses frames one after another. A frame's Fuser is used for the next frames too while their model, size,
// sampling and constant layers are the same. Each result is that of a frame fused alone.
class FrameFuser {
 public:
  // `device` must outlive this.
  explicit FrameFuser(const Device& device);
  ~FrameFuser();

  // Starts a thread that compiles the kernels which the frame will probably need, judged without its pixels.
  // Notes that it compiles if the device has no kernels on disk yet.
  void prepare(const FuseFrame& frame);

  // Fuses a frame with its companions and stages the files of --dump. All frames must have the same options.
  // A lead-in frame is only taken into the history. Throws Error, and Cancelled when `progress` returns
  // false; the next frame may still work then.
  void fuse(FuseFrame& frame, const Progress& progress);

 private:
  struct Cached;
  struct Preparation;
  Cached& cached_for(FuseFrame& frame);
  void fuse_color(FuseFrame& frame, Cached& cached, const Progress& progress);
  Image fuse_companion(FuseFrame& frame, const Companion& companion, const Image& hrls, float exposure,
                       Fuser& fuser, const Progress& progress);

  void go_on(FuseFrame& frame, size_t sequence, Fuser& fuser);

  // Names the frame that a history of `cached_` is of.
  struct LastFrame {
    int number = 0;
    Imath::Box2i window;
  };

  const Device& device_;
  std::map<size_t, LastFrame> last_frames_;  // keyed by sequence
  std::unique_ptr<Preparation> preparation_;
  std::unique_ptr<Cached> cached_;
};

// Stages all outputs, the fused image last; measures it if there is a reference. Throws Error and Cancelled.
QualityTable stage_outputs(FuseFrame& frame);

}  // namespace raymeld::cli
