// Finds the color of images that commands read, and replaces values that are not finite.
#pragma once

#include "cli/common/console.h"
#include "io/layers_from_exr.h"

namespace raymeld::cli {

extern const std::vector<std::string> kColor;  // the one layer that every image has

// Finds the color layer of a file that `choice` was not made for; ignores parts of `choice` that do not fit.
LayerMap map_color(const ExrFile& file, const LayerChoice& choice);

// Calls sanitize() and warns of NaN and of infinities; `role` is the file's name in warnings, such as "LRHS".
void sanitize_input(Image& image, const char* role, const std::filesystem::path& path, Console& console);

// Warns of values that are not finite in a channel that is copied to the output. If `mends`, NaN becomes 0
// and an infinity +-65504. If not, values stay, and infinities, which a depth may have, cause no warning.
void sanitize_passed(ExrRawChannel& channel, bool mends, const char* role, const std::filesystem::path& path,
                     Console& console);

}  // namespace raymeld::cli
