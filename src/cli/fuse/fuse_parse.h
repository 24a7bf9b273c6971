// Values of the options of fuse, from their texts; each throws Error where a text is none.
#pragma once

#include <Imath/ImathBox.h>

#include <optional>
#include <string>

namespace raymeld::cli {

// 0 for "auto" and 1 for "off".
float parse_exposure(const std::string& text);

// None for "auto" and 0 for "off".

// From "X,Y,WIDTH,HEIGHT".
std::optional<Imath::Box2i> parse_window(const std::string& text);

}  // namespace raymeld::cli
