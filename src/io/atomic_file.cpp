#include "io/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>

#include "error.h"

namespace raymeld {
namespace {

namespace fs = std::filesystem;

// A link is followed, so that the file behind it is replaced and not the link.
fs::path resolved_target(const fs::path& path) {
  const fs::file_status status = fs::status(path);
  if (fs::is_directory(status)) throw Error("cannot write '{}': it is a folder", path.string());
  if (fs::exists(status) && !fs::is_regular_file(status))
    throw Error("cannot write '{}': it is not a regular file", path.string());
  return fs::is_symlink(fs::symlink_status(path)) ? fs::weakly_canonical(path) : path;
}

// Opened with 0666 like any new file, so that the umask decides, which mkstemp does not allow.
int create_beside(const fs::path& target, fs::path& temporary_path) {
  static std::atomic<unsigned> counter = 0;
  int file = -1;
  do {
    temporary_path = target.parent_path() / fmt::format(".raymeld-{}-{}.tmp", getpid(), counter++);
    file = open(temporary_path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  } while (file < 0 && errno == EEXIST);
  return file;
}

// Makes the rename last through a power cut; where the file system cannot, nothing is lost but that.
void sync_folder(const fs::path& folder) {
  const int handle = open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (handle < 0) return;
  fsync(handle);
  close(handle);
}

}  // namespace

AtomicFile::AtomicFile(const fs::path& path) try : path_(resolved_target(path)) {
  const int file = create_beside(path_, temporary_path_);
  if (file < 0) throw Error("cannot write '{}': {}", path.string(), std::strerror(errno));
  file_ = fdopen(file, "wb");
  if (file_) return;
  error_ = errno;
  close(file);
  unlink(temporary_path_.c_str());
  fail();
} catch (const fs::filesystem_error& error) {
  throw Error("cannot write '{}': {}", path.string(), error.code().message());
}

AtomicFile::~AtomicFile() {
  if (!file_) return;
  std::fclose(file_);
  unlink(temporary_path_.c_str());
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

void AtomicFile::commit() {
  if (error_ != 0 || std::fflush(file_) != 0 || fsync(fileno(file_)) != 0) fail();
  if (std::rename(temporary_path_.c_str(), path_.c_str()) != 0) fail();
  std::fclose(file_);
  file_ = nullptr;
  sync_folder(path_.parent_path());
}

}  // namespace raymeld
