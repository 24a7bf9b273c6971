#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

namespace raymeld::test {

// A file without a folder: what is fuzzed reads paths, and a disk would be in the way.
class MemoryFile {
 public:
  explicit MemoryFile(std::span<const uint8_t> content);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  int descriptor_;
  std::filesystem::path path_;
};

}  // namespace raymeld::test
