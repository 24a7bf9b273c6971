#include "io/input_file.h"

#include <cerrno>
#include <cstring>
#include <fstream>

#include "error.h"

namespace raymeld {

void check_input_file(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found)
    throw Error("cannot read '{}': there is no such file", path.string());
  if (error) throw Error("cannot read '{}': {}", path.string(), error.message());
  if (std::filesystem::is_directory(status)) throw Error("cannot read '{}': it is a folder", path.string());
  if (!std::filesystem::is_regular_file(status))
    throw Error("cannot read '{}': it is not a regular file", path.string());
  if (!std::ifstream(path)) throw Error("cannot read '{}': {}", path.string(), std::strerror(errno));
}

}  // namespace raymeld
