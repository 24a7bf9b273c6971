// The parts of the command `fuse`, in the order in which it runs them.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>

#include "cli/console.h"
#include "cli/frame.h"
#include "cli/outputs.h"
#include "cli/quality.h"
#include "fuser.h"
#include "io/layers_from_exr.h"

namespace raymeld::cli {

// What becomes of a frame with values that --precision fp16 cannot hold.
enum class Overflow { kError, kWarn, kRedo };

struct FuseArguments {
  std::string lrhs, hrls, output, model, device, reference, preview, before_after, dump;
  Precision precision = Precision::kAuto;
  Overflow overflow = Overflow::kError;
  KernelChoice kernels = KernelChoice::kAuto;
  std::string sampling = "auto", output_type = "auto";
  std::vector<std::string> map, lrhs_map;
  float exposure_stops = 0;
  std::optional<float> threshold = {};  // of --adaptive; 0: off, none: as the frame suggests
  float input_exposure = 0;             // 0: what the model asks for
  uint64_t max_memory_mib = 0;
  bool keep_layers = false, profile = false, dry_run = false, json = false, quiet = false;

  std::vector<std::filesystem::path> inputs() const;
  // Without the folder of --dump.
  std::vector<std::filesystem::path> outputs() const;
  std::filesystem::path dump_folder() const;  // without a last slash
};

// The files, open, with all that can be known before their pixels are read.
struct FuseFiles {
  ExrFile lrhs, hrls;
  LayerMap lrhs_map, hrls_map;
  Windows lrhs_windows, hrls_windows;  // of the colour's part
  Model model;
  Canvas canvas;
  std::vector<std::string> absent_layers;  // that the model takes and does without
  float phase = 0;                         // of LRHS samples; see FuserOptions
  std::optional<ExrFile> reference;
  LayerMap reference_map;

  const ExrChannel& hrls_color() const { return hrls.channel(hrls_map.layers.at("color").terms[0][0]); }
};

// The whole command. Throws Error and Cancelled; then no output is left behind.
void run_fuse(const FuseArguments& arguments);

// The channels of HRLS that the output holds as they are: alpha, or all but the colour.
std::vector<std::string> passed_channels(const FuseFiles& files, bool keep_layers);

// Throws Error when a file, a layer or a model is missing, or sizes or windows do not fit.
FuseFiles open_files(const FuseArguments& arguments);

struct FuseImages {
  Image lrhs, hrls;                // of the canvas: (3, h, w) and (K, s h, s w), all finite
  std::optional<Image> reference;  // (3, H, W) of HRLS's data window
  std::vector<ExrRawChannel> passed;
};

// The canvas's (3, h, w), all finite.
Image load_lrhs(FuseFiles& files, Console& console);

// All that is read of the files, so that what becomes of them while a frame is fused makes no difference.
FuseImages load_images(const FuseArguments& arguments, FuseFiles& files, Console& console);

// What --adaptive asks for: without a word, the default where enough of the frame is settled, else 0.
float find_threshold(const FuseArguments& arguments, const FuseFiles& files, const FuseImages& images);

FuserOptions fuser_options(const FuseArguments& arguments, const FuseFiles& files, const Device& device,
                           float threshold);

const char* precision_name(Storage storage);

struct FuseResult {
  Image fused;  // (3, H, W) of HRLS's data window
  FuseReport report;
  Tiling tiling;
  uint64_t allocated_bytes = 0;
  Storage storage = Storage::kFloat32;
};

// Runs one frame; writes what --dump asks for. Throws Cancelled after a signal.
FuseResult run_frame(const FuseArguments& arguments, const FuseFiles& files, const FuseImages& images,
                     const Device& device, Console& console, StagedFiles& staged);

// The images that fused is measured against and shown beside, all (3, H, W) of HRLS's data window.
struct Comparison {
  Image bicubic, hrls;
};

Comparison make_comparison(const FuseFiles& files, const FuseImages& images);

// `comparison` is needed for --preview-before-after only.
void write_outputs(const FuseArguments& arguments, const FuseFiles& files, FuseImages& images,
                   const std::optional<Comparison>& comparison, const FuseResult& result, Console& console,
                   StagedFiles& staged);

std::string profile_text(const FuseReport& report);
nlohmann::ordered_json to_json(const std::vector<PassTime>& passes);
// {layer: {rule, channels}}, the channels three by three.
nlohmann::ordered_json to_json(const LayerMap& map);

}  // namespace raymeld::cli
