#pragma once

#include <string>

#include "model/model.h"
#include "fusion/tiling.h"

namespace raymeld::cli {

// Height and width of `size`, "WxH" in pixels. Throws Error.
TileSize parse_size(const std::string& size);

// The LRHS size of fused images of `size`, "WxH". Throws Error, also where that is no multiple of the scale.
TileSize lrhs_size(const Model& model, const std::string& size);

}  // namespace raymeld::cli
