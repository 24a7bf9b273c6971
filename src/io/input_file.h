#pragma once

#include <filesystem>

namespace raymeld {

// Throws Error, naming `path`, unless it is a regular file (or a link to one) that may be read.
void check_input_file(const std::filesystem::path& path);

}  // namespace raymeld
