// Computes the paper's three measures of an image against its reference, and writes them as table and JSON.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "io/image.h"

namespace raymeld::cli {

struct Quality {
  double psnr_db = 0;        // sRGB, Eq. 3; infinite for equal images
  double relmse_bcr = 0;     // Eq. 11 with (0.5, 0.01)
  double relmse_gharbi = 0;  // Eq. 11 with (1, 1e-4)
};

using QualityTable = std::vector<std::pair<std::string, Quality>>;  // images' names and measures

// Throws Error unless both are (3, H, W) of one size.
Quality measure(const Image& image, const Image& reference);

std::string table(const QualityTable& rows);

// Returns {name: {psnr_db, relmse_bcr, relmse_gharbi}}; an infinite PSNR is null, as JSON has no infinity.
nlohmann::ordered_json to_json(const QualityTable& rows);

}  // namespace raymeld::cli
