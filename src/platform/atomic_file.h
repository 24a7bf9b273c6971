#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string_view>

namespace raymeld {

// Writes a file that appears whole or not at all, even if the program is killed or the power fails. It has no
// name until commit(); until then an older file of that name stays as it was. It is called .raymeld-*.tmp, in
// the target's folder, for the moment in which it replaces an older file, and from the start where the file
// system has no unnamed files (NFS, Windows). A kill then leaves it behind; nothing reads it, and anyone may
// delete it. Every function throws an Error that names the target. After a failure commit() can only throw.
class AtomicFile {
 public:
  // Refuses a target that exists and is not a regular file. `unnamed` is false in tests of temporary names.
  explicit AtomicFile(const std::filesystem::path& path, bool unnamed = true);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& path() const { return path_; }
  void write(const void* data, size_t size_bytes);
  uint64_t position();
  void seek(uint64_t position);

  // Brings all that was written to the disk (fsync), so that commit() meets no full disk and little work.
  void finish();
  // Calls finish(), publish() and sync_folder().
  void commit();
  // Gives the file its name, even if it is not on the disk yet. To publish several files at almost the same
  // time, finish() all of them first, and call sync_folder() afterwards.
  void publish();
  // Makes the name survive a power cut. Nothing else is lost if the file system cannot do this.
  void sync_folder() const;

 private:
  [[noreturn]] void fail();
  void name_unnamed();
  void remove_temporary() const;

  std::filesystem::path path_;
  std::filesystem::path temporary_path_;  // empty while the file has no name
  std::FILE* file_ = nullptr;
  int error_ = 0;  // errno of the first failure
};

// Writes `text` as the file, whole or not at all. Throws Error.
void write_whole(const std::filesystem::path& file, std::string_view text);

}  // namespace raymeld
