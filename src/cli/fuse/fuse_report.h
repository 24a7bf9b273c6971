// Reports on a frame: lines for stderr, text and JSON for stdout.
#pragma once

#include "cli/fuse/fuse.h"

namespace raymeld::cli {

// Returns phrases on what the user should know about the files: how LRHS was sampled, missing layers, a model
// that was not trained on such files.
std::vector<std::string> findings(const FuseFiles& files);

// Does the same for a frame whose pixels are read, and adds its constant layers and its exposure.
std::vector<std::string> findings(const FuseFrame& frame);

// Returns three lines: what was read, what it runs on, what was found. `names` has the names of the files,
// which are patterns for a sequence.
std::vector<std::string> opening_lines(const FuseArguments& names, const FuseFrame& frame,
                                       const DeviceInfo& device);

// These return the lines of opening_lines() one by one.
std::string read_text(const FuseArguments& names, const FuseFiles& files);
std::string device_text(const FuseFiles& files, const DeviceInfo& device, Storage storage);
std::string found_text(const std::vector<std::string>& findings);

// Returns the channels that each layer comes from, a line each, for --verbose and --dry-run.
std::string channels_text(const FuseArguments& names, const FuseFiles& files);

// Returns the times, the memory and the exposure of a fused frame, and how much of its work was skipped.
std::string took_text(const FuseFrame& frame, double total_ms);

// Returns the files that were written, separated by commas.
std::string written_text(const FuseArguments& arguments);

// Returns the tables of --profile and --reference; empty without these.
std::string frame_text(const FuseFrame& frame, const QualityTable& quality);

// Returns the object that --json prints for a fused frame.
nlohmann::ordered_json frame_json(const FuseFrame& frame, const DeviceInfo& device,
                                  const QualityTable& quality, double total_ms);

// Returns the part of frame_json() that is known before the frame is fused.
nlohmann::ordered_json facts(const FuseFiles& files, const DeviceInfo& device, Storage storage,
                             const Tiling& tiling, float exposure);

// Returns {layer: {rule, channels}}, with channels in groups of three.
nlohmann::ordered_json to_json(const LayerMap& map);

// Returns the layers that are in HRLS's file but have one value everywhere.
ConstantLayers found_constants(const FuseFrame& frame);

const char* sampling_name(const FuseFiles& files);
const char* sampling_source(const FuseFiles& files);

// Returns the rate of `count` operations or bytes in `time_ms`, in 10^9 a second; 0 if no time was measured.
double giga_per_second(double count, double time_ms);

}  // namespace raymeld::cli
