// The file of `raymeld conform --values`.
#pragma once

#include <filesystem>

#include "conform/conform.h"

namespace raymeld::conform {

// JSON, whole or not at all. Throws Error.
void write_values(const std::filesystem::path& file, const Values& values);
// Throws Error.
Values read_values(const std::filesystem::path& file);

}  // namespace raymeld::conform
