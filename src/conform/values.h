// Writes and reads the file of `raymeld conform --values`.
#pragma once

#include <filesystem>

#include "conform/conform.h"

namespace raymeld::conform {

// Writes JSON, the whole file or nothing. Throws Error.
void write_values(const std::filesystem::path& file, const Values& values);
// Throws Error.
Values read_values(const std::filesystem::path& file);

}  // namespace raymeld::conform
