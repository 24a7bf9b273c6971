#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>

namespace raymeld {

// A file that appears whole or not at all: written under a temporary name in the target's folder, renamed by
// commit(). Without commit() the destructor removes it and an older file of that name stays as it was.
// Every function throws Error, naming the target; after one failure commit() can only throw.
class AtomicFile {
 public:
  // Refuses a target that exists and is no regular file.
  explicit AtomicFile(const std::filesystem::path& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(const void* data, size_t size_bytes);
  uint64_t position();
  void seek(uint64_t position);

  // Flushes to the disk (fsync) and renames.
  void commit();

 private:
  [[noreturn]] void fail();

  std::filesystem::path path_;
  std::filesystem::path temporary_path_;
  std::FILE* file_ = nullptr;
  int error_ = 0;  // errno of the first failure
};

}  // namespace raymeld
