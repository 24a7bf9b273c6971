#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string_view>

namespace raymeld {

// A file that appears whole or not at all, whenever the program is killed or the power fails: it has no name,
// and an older file of its name stays as it was, until commit(). Beside its target it lies as .raymeld-*.tmp
// for the moment in which it replaces an older file, and where the file system has no unnamed files (NFS) all
// the time until then; a kill leaves that behind, which nothing reads and anyone may delete.
// Every function throws Error, naming the target; after one failure commit() can only throw.
class AtomicFile {
 public:
  // Refuses a target that exists and is no regular file. `unnamed`: false is for tests of the other way.
  explicit AtomicFile(const std::filesystem::path& path, bool unnamed = true);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& path() const { return path_; }
  void write(const void* data, size_t size_bytes);
  uint64_t position();
  void seek(uint64_t position);

  // Brings all that was written to the disk (fsync), so that commit() finds neither a full disk nor much to
  // do.
  void finish();
  // finish(), then the name, then sync_folder().
  void commit();
  // Of several files, names given at one stroke: after finish(), and with sync_folder() behind.
  void publish();
  // Makes the name last through a power cut; where the file system cannot, nothing is lost but that.
  void sync_folder() const;

 private:
  [[noreturn]] void fail();
  void link_unnamed();

  std::filesystem::path path_;
  std::filesystem::path temporary_path_;  // empty while the file has no name
  std::FILE* file_ = nullptr;
  int error_ = 0;  // errno of the first failure
};

// The file, whole or not at all. Throws Error.
void write_whole(const std::filesystem::path& file, std::string_view text);

}  // namespace raymeld
