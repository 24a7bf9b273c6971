// What the program says of a frame: lines on stderr, text and JSON on stdout.
#pragma once

#include "cli/fuse/fuse.h"

namespace raymeld::cli {

// Phrases for what the user should know about the files: what LRHS is, missing layers, a model that was not
// trained on such files.
std::vector<std::string> findings(const FuseFiles& files);

// The same for a frame whose pixels are read: also its constant layers.
std::vector<std::string> findings(const FuseFrame& frame);

// Three lines: what was read, what it runs on, what was found. `names` has the names of the files: those of a
// sequence are patterns.
std::vector<std::string> opening_lines(const FuseArguments& names, const FuseFrame& frame,
                                       const DeviceInfo& device);

// The lines of opening_lines() that need no pixels.
std::string read_text(const FuseArguments& names, const FuseFiles& files);
std::string device_text(const FuseArguments& arguments, const FuseFiles& files, const DeviceInfo& device);
std::string found_text(const std::vector<std::string>& findings);

// The channels that each layer comes from, a line each, for --verbose and --dry-run.
std::string channels_text(const FuseArguments& names, const FuseFiles& files);

// The times, the memory and the exposure of a fused frame, and the share of the work that was done.
std::string took_text(const FuseFrame& frame, double total_ms);

// The files that were written, by commas.
std::string written_text(const FuseArguments& arguments);

// The tables that --profile and --reference ask for; empty without them.
std::string frame_text(const FuseFrame& frame, const QualityTable& quality);

// The object that --json prints of a fused frame.
nlohmann::ordered_json frame_json(const FuseFrame& frame, const DeviceInfo& device,
                                  const QualityTable& quality, double total_ms);

// The part of frame_json() that is known of a frame before it is fused.
nlohmann::ordered_json facts(const FuseFiles& files, const DeviceInfo& device, Storage storage,
                             const Tiling& tiling, float exposure);

// {layer: {rule, channels}}, the channels three by three.
nlohmann::ordered_json to_json(const LayerMap& map);

// The layers that are in HRLS's file but have one value everywhere.
ConstantLayers found_constants(const FuseFrame& frame);

const char* sampling_name(const FuseFiles& files);
const char* sampling_source(const FuseFiles& files);

// Operations, or bytes, in `time_ms`, in thousands of millions a second; 0 where no time was measured.
double giga_per_second(double count, double time_ms);

}  // namespace raymeld::cli
