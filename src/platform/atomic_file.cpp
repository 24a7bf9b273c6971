#include "platform/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>

#include "error.h"

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

// Tries unused names in the folder of `target`, until `make` takes one or fails for another reason.
template <typename Make>
int make_beside(const fs::path& target, fs::path& temporary_path, Make&& make) {
  static std::atomic<unsigned> counter = 0;
  int result = -1;
  do {
    temporary_path = target.parent_path() / fmt::format(".raymeld-{}-{}.tmp", getpid(), counter++);
    result = make(temporary_path.c_str());
  } while (result < 0 && errno == EEXIST);
  if (result < 0) temporary_path.clear();
  return result;
}

std::string path_of(int file) { return fmt::format("/proc/self/fd/{}", file); }

fs::path folder_of(const fs::path& path) { return path.has_parent_path() ? path.parent_path() : "."; }

// Returns -1 if the file system has no unnamed files, or if they could not be given a name.
int open_unnamed(const fs::path& target) {
  const int file = open(folder_of(target).c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666);
  if (file < 0 || access(path_of(file).c_str(), F_OK) == 0) return file;
  close(file);
  return -1;
}

// Makes the file with 0666 like any new file, so that the umask decides; mkstemp() does not allow that.
int open_named(const fs::path& target, fs::path& temporary_path) {
  return make_beside(target, temporary_path, [](const char* name) {
    return open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  });
}

}  // namespace

AtomicFile::AtomicFile(const fs::path& path, bool unnamed) try : path_(resolved_target(path)) {
  int file = unnamed ? open_unnamed(path_) : -1;
  if (file < 0) file = open_named(path_, temporary_path_);
  if (file < 0) throw Error("cannot write '{}': {}", path.string(), std::strerror(errno));
  file_ = fdopen(file, "wb");
  if (file_) return;
  error_ = errno;
  close(file);
  if (!temporary_path_.empty()) unlink(temporary_path_.c_str());
  fail();
} catch (const fs::filesystem_error& error) {
  throw Error("cannot write '{}': {}", path.string(), error.code().message());
}

AtomicFile::~AtomicFile() {
  if (!file_) return;
  std::fclose(file_);
  if (!temporary_path_.empty()) unlink(temporary_path_.c_str());
}

void AtomicFile::fail() {
  if (error_ == 0) error_ = errno;
  throw Error("cannot write '{}': {}", path_.string(), std::strerror(error_));
}

void AtomicFile::write(const void* data, size_t size_bytes) {
  if (error_ != 0 || std::fwrite(data, 1, size_bytes, file_) != size_bytes) fail();
}

uint64_t AtomicFile::position() {
  const off_t position = ftello(file_);
  if (position < 0) fail();
  return uint64_t(position);
}

void AtomicFile::seek(uint64_t position) {
  if (error_ != 0 || fseeko(file_, off_t(position), SEEK_SET) != 0) fail();
}

void AtomicFile::finish() {
  if (error_ != 0 || std::fflush(file_) != 0 || fsync(fileno(file_)) != 0) fail();
}

// linkat() refuses a name that another file has, so an older file is replaced by way of a temporary name.
void AtomicFile::link_unnamed() {
  const auto link = [own = path_of(fileno(file_))](const char* name) {
    return linkat(AT_FDCWD, own.c_str(), AT_FDCWD, name, AT_SYMLINK_FOLLOW);
  };
  if (link(path_.c_str()) == 0) return;
  if (errno != EEXIST || make_beside(path_, temporary_path_, link) < 0) fail();
}

void AtomicFile::publish() {
  if (error_ != 0) fail();
  if (temporary_path_.empty()) link_unnamed();
  if (!temporary_path_.empty() && std::rename(temporary_path_.c_str(), path_.c_str()) != 0) fail();
  std::fclose(file_);
  file_ = nullptr;
}

void AtomicFile::sync_folder() const {
  const int handle = open(folder_of(path_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (handle < 0) return;
  fsync(handle);
  close(handle);
}

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
