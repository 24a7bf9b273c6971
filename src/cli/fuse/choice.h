// Which model fuse takes, where it is asked for a quality or a time instead of a name.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cli/fuse/fuse.h"

namespace raymeld::cli {

// From "fast", "balanced", "high" or a number from 0 to 100. Throws Error.
std::optional<Wish> parse_quality(const std::string& text);
// From "16ms" or "2s". Throws Error.
std::optional<Wish> parse_budget(const std::string& text);
// From a number of dB. Throws Error.
std::optional<Wish> parse_target(const std::string& text);

// Chooses among the stock models of the frame's scale, for the frame of `arguments` (without patterns), whose
// wish must be there, or for a sequence of frames like it. Measures the device for a budget, unless it did
// before; reads the colors for a target PSNR. Says what it chose and why. Throws Error.
Choice choose_model(const FuseArguments& arguments, bool sequence, const Device& device, LastModel& models,
                    Console& console);

nlohmann::ordered_json to_json(const Choice& choice);

}  // namespace raymeld::cli
