#pragma once

#include <string>

#include "fusion/tiling.h"
#include "networks/model.h"

namespace raymeld::cli {

// Parses `size`, "WxH" in pixels. Throws Error.
TileSize parse_size(const std::string& size);

// Returns the LRHS size for fused images of `size`, "WxH". Throws Error, also when `size` is not a multiple
// of the model's scale.
TileSize lrhs_size(const Model& model, const std::string& size);

}  // namespace raymeld::cli
