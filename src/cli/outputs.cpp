#include "cli/outputs.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "error.h"
#include "io/atomic_file.h"

namespace raymeld::cli {

namespace fs = std::filesystem;

void check_output(const fs::path& output, std::span<const fs::path> inputs) {
  std::error_code error;
  if (fs::is_directory(output, error)) throw Error("cannot write '{}': it is a folder", output.string());
  for (const fs::path& input : inputs) {
    if (fs::equivalent(output, input, error)) {
      throw Error("cannot write '{}': it is the same file as the input '{}'", output.string(),
                  input.string());
    }
  }
  const fs::path folder = output.has_parent_path() ? output.parent_path() : ".";
  if (!fs::is_directory(folder, error)) {
    throw Error("cannot write '{}': there is no folder '{}'", output.string(), folder.string());
  }
  if (eaccess(folder.c_str(), W_OK | X_OK) != 0) {
    throw Error("cannot write '{}': folder '{}': {}", output.string(), folder.string(), std::strerror(errno));
  }
}

WrittenFiles::~WrittenFiles() {
  std::error_code error;
  for (auto file = files_.rbegin(); file != files_.rend(); ++file) fs::remove(*file, error);
}

void write_npy(const fs::path& path, std::span<const float> values, size_t channels, size_t height,
               size_t width) {
  constexpr size_t kPrefixBytes = 10, kAlignmentBytes = 64;
  std::string header = fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}, {}), }}",
                                   channels, height, width);
  // The values start at a multiple of 64 bytes, after a line end.
  const size_t unpadded = kPrefixBytes + header.size() + 1;
  header.append((kAlignmentBytes - unpadded % kAlignmentBytes) % kAlignmentBytes, ' ');
  header += '\n';
  const std::string prefix = {
      '\x93', 'N', 'U', 'M', 'P', 'Y', 1, 0, char(header.size() % 256), char(header.size() / 256)};
  AtomicFile file(path);
  file.write(prefix.data(), prefix.size());
  file.write(header.data(), header.size());
  file.write(values.data(), values.size_bytes());
  file.commit();
}

}  // namespace raymeld::cli
