// Chooses the model of fuse, denoise or upscale when the user asks for a quality or a time and names no
// model.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cli/fuse/fuse.h"

namespace raymeld::cli {

// Parses "fast", "balanced", "high" or a number from 0 to 100. Throws Error.
std::optional<ModelRequest> parse_quality(const std::string& text);
// Parses "16ms" or "2s". Throws Error.
std::optional<ModelRequest> parse_budget(const std::string& text);

// Chooses among the stock models of the frame's scale by the quality or time that `arguments` must ask for.
// The paths in `arguments` are no patterns; with `sequence` the choice is for a sequence of such frames.
// Measures models on the device for a budget, unless that was done before. Notes the choice and its reason.
// Throws Error.
Choice choose_model(const FuseArguments& arguments, bool sequence, const Device& device, LastModel& models,
                    Console& console);

nlohmann::ordered_json to_json(const Choice& choice);

}  // namespace raymeld::cli
