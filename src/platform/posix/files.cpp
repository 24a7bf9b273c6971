#include "platform/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

namespace raymeld {
namespace {

std::string path_of(int file) { return fmt::format("/proc/self/fd/{}", file); }

}  // namespace

// eaccess() checks for the effective user, as open() does.
bool may_write_in(const std::filesystem::path& folder) { return eaccess(folder.c_str(), W_OK | X_OK) == 0; }

// Without /proc the file could not be given a name.
int make_unnamed_file(const std::filesystem::path& folder) {
  const int file = open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666);
  if (file < 0 || access(path_of(file).c_str(), F_OK) == 0) return file;
  close(file);
  return -1;
}

// 0666 lets the umask decide, which mkstemp() does not allow.
int make_file(const std::filesystem::path& path) {
  return open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
}

bool name_file(int unnamed, const std::filesystem::path& path) {
  return linkat(AT_FDCWD, path_of(unnamed).c_str(), AT_FDCWD, path.c_str(), AT_SYMLINK_FOLLOW) == 0;
}

bool sync_file(int file) { return fsync(file) == 0; }

void sync_folder(const std::filesystem::path& folder) {
  const int handle = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (handle < 0) return;
  fsync(handle);
  close(handle);
}

int copy_descriptor(int file) { return fcntl(file, F_DUPFD_CLOEXEC, 0); }
void close_descriptor(int file) { close(file); }
std::FILE* stream_of(int file) { return fdopen(file, "wb"); }
int descriptor_of(std::FILE* stream) { return fileno(stream); }
int64_t position_of(std::FILE* stream) { return ftello(stream); }
bool seek_to(std::FILE* stream, int64_t position) { return fseeko(stream, off_t(position), SEEK_SET) == 0; }

}  // namespace raymeld
