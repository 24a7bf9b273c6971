#include "platform/atomic_file.h"

#include <cerrno>
#include <cstring>
#include <random>

#include "error.h"
#include "platform/files.h"

namespace raymeld {
namespace {

namespace fs = std::filesystem;

// Follows a link, so that the file it points to is replaced and not the link.
fs::path resolved_target(const fs::path& path) {
  const fs::file_status status = fs::status(path);
  if (fs::is_directory(status)) throw Error("cannot write '{}': it is a folder", path.string());
  if (fs::exists(status) && !fs::is_regular_file(status))
    throw Error("cannot write '{}': it is not a regular file", path.string());
  return fs::is_symlink(fs::symlink_status(path)) ? fs::weakly_canonical(path) : path;
}

// Tries names in the folder of `target`, until `make` takes one or fails for another reason than that the
// name is taken. Returns that name, or an empty path.
template <typename Make>
fs::path make_beside(const fs::path& target, Make&& make) {
  std::random_device random;
  for (;;) {
    const fs::path path = target.parent_path() / fmt::format(".raymeld-{:08x}.tmp", random());
    if (make(path)) return path;
    if (errno != EEXIST) return {};
  }
}

fs::path folder_of(const fs::path& path) { return path.has_parent_path() ? path.parent_path() : "."; }

}  // namespace

AtomicFile::AtomicFile(const fs::path& path, bool unnamed) try : path_(resolved_target(path)) {
  int file = unnamed ? make_unnamed_file(folder_of(path_)) : -1;
  if (file < 0)
    temporary_path_ = make_beside(path_, [&](const fs::path& name) { return (file = make_file(name)) >= 0; });
  if (file < 0) throw Error("cannot write '{}': {}", path.string(), std::strerror(errno));
  file_ = stream_of(file);
  if (file_) return;
  error_ = errno;
  close_descriptor(file);
  remove_temporary();
  fail();
} catch (const fs::filesystem_error& error) {
  throw Error("cannot write '{}': {}", path.string(), error.code().message());
}

AtomicFile::~AtomicFile() {
  if (!file_) return;
  std::fclose(file_);
  remove_temporary();
}

void AtomicFile::remove_temporary() const {
  std::error_code ignored;
  if (!temporary_path_.empty()) fs::remove(temporary_path_, ignored);
}

void AtomicFile::fail() {
  if (error_ == 0) error_ = errno;
  throw Error("cannot write '{}': {}", path_.string(), std::strerror(error_));
}

void AtomicFile::write(const void* data, size_t size_bytes) {
  if (error_ != 0 || std::fwrite(data, 1, size_bytes, file_) != size_bytes) fail();
}

uint64_t AtomicFile::position() {
  const int64_t position = position_of(file_);
  if (position < 0) fail();
  return uint64_t(position);
}

void AtomicFile::seek(uint64_t position) {
  if (error_ != 0 || !seek_to(file_, int64_t(position))) fail();
}

void AtomicFile::finish() {
  if (error_ != 0 || std::fflush(file_) != 0 || !sync_file(descriptor_of(file_))) fail();
}

// A name that another file has is not given, so an older file is replaced by way of a temporary name.
void AtomicFile::name_unnamed() {
  const auto name = [&](const fs::path& path) { return name_file(descriptor_of(file_), path); };
  if (name(path_)) return;
  if (errno == EEXIST) temporary_path_ = make_beside(path_, name);
  if (temporary_path_.empty()) fail();
}

// Windows gives no other name to a file that is open.
void AtomicFile::publish() {
  if (error_ != 0 || std::fflush(file_) != 0) fail();
  if (temporary_path_.empty()) name_unnamed();
  std::fclose(file_);
  file_ = nullptr;
  if (temporary_path_.empty()) return;
  std::error_code error;
  fs::rename(temporary_path_, path_, error);
  if (!error) return;
  error_ = error.default_error_condition().value();
  remove_temporary();
  fail();
}

void AtomicFile::sync_folder() const { raymeld::sync_folder(folder_of(path_)); }

void AtomicFile::commit() {
  finish();
  publish();
  sync_folder();
}

void write_whole(const std::filesystem::path& file, std::string_view text) {
  AtomicFile out(file);
  out.write(text.data(), text.size());
  out.commit();
}

}  // namespace raymeld
