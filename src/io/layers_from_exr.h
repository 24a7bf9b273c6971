#pragma once

#include <span>
#include <string>

#include "io/exr.h"
#include "io/layer_map.h"

namespace raymeld {

// Calls map_layers() with the file's channels; its Errors name the file.
LayerMap map_layers(const ExrFile& file, const LayerChoice& choice = {});

// Returns (3 * wanted.size(), H, W), the layers in the order of `wanted`, with NaN and Inf as in the file
// (see sanitize()). Throws Error as require_layers() and ExrFile::read() do.
Image load_layers(ExrFile& file, const LayerMap& map, std::span<const std::string> wanted);

// Returns (4, H, W): the pixels to the right and downwards that lead to the same point in the last frame, and
// twice its depth, which is 0 where the file has none: see FuserOptions::motion_depth. Throws Error as
// ExrFile::read() does; `map` must have motion.
Image load_motion(ExrFile& file, const LayerMap& map);

}  // namespace raymeld
