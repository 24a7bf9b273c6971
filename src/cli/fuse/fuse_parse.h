// Parses the values of fuse's options. Each function throws Error for a text that is not valid.
#pragma once

#include <Imath/ImathBox.h>

#include <optional>
#include <string>

namespace raymeld::cli {

// Returns 0 for "auto" and 1 for "off".
float parse_exposure(const std::string& text);

// Parses "X,Y,WIDTH,HEIGHT".
std::optional<Imath::Box2i> parse_window(const std::string& text);

}  // namespace raymeld::cli
