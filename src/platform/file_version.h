#pragma once

#include <cstdint>
#include <filesystem>

namespace raymeld {

// Tells whether a file that is read piece by piece stayed the same meanwhile.
class FileVersion {
 public:
  // Notes the file's state; this must happen before the file is opened.
  explicit FileVersion(const std::filesystem::path& path);
  // Throws Error, naming `path`, when the file was written to since. A new file in its place is no change, as
  // the open file stays as it was.
  void check(const std::filesystem::path& path) const;

 private:
  uint64_t device_ = 0, inode_ = 0, size_bytes_ = 0;
  int64_t seconds_ = 0, nanoseconds_ = 0;  // time of the last change
};

}  // namespace raymeld
