// What fuse and compare do alike with the images they read.
#pragma once

#include "cli/common/console.h"
#include "io/layers_from_exr.h"

namespace raymeld::cli {

extern const std::vector<std::string> kColor;  // the one layer that every image has

// Finds the colour of a file that `choice` was not made for: what of it does not fit is found automatically.
LayerMap map_color(const ExrFile& file, const LayerChoice& choice);

// sanitize(), with a warning for NaN and one for infinities; `role` says what the file is.
void sanitize_input(Image& image, const char* role, const std::filesystem::path& path, Console& console);

// Counts what is not finite in a channel that is written as it was read, and warns of it. Where `mends`, NaN
// becomes 0 and infinities +-65504; else infinities, which a depth may have, are no concern.
void sanitize_passed(ExrRawChannel& channel, bool mends, const std::filesystem::path& path, Console& console);

}  // namespace raymeld::cli
