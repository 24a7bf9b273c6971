// The file of `raymeld conform --values`.
#pragma once

#include <filesystem>

#include "conform/conform.h"

namespace raymeld::cli {

// JSON, whole or not at all. Throws Error.
void write_values(const std::filesystem::path& file, const conform::Values& values);
// Throws Error.
conform::Values read_values(const std::filesystem::path& file);

}  // namespace raymeld::cli
