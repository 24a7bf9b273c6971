#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

namespace raymeld::test {

// Holds a file in memory and gives it a path, as the functions under test read paths; no disk is needed.
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
