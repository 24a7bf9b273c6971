#include "platform/files.h"

#include <fcntl.h>
#include <io.h>
#include <sys/stat.h>

#include <cerrno>

namespace raymeld {

int make_unnamed_file(const std::filesystem::path&) {
  errno = ENOTSUP;
  return -1;
}

int make_file(const std::filesystem::path& path) {
  return _wopen(path.c_str(), _O_WRONLY | _O_CREAT | _O_EXCL | _O_BINARY | _O_NOINHERIT,
                _S_IREAD | _S_IWRITE);
}

bool name_file(int, const std::filesystem::path&) {
  errno = ENOTSUP;
  return false;
}

bool sync_file(int file) { return _commit(file) == 0; }
void sync_folder(const std::filesystem::path&) {}
int copy_descriptor(int file) { return _dup(file); }
void close_descriptor(int file) { _close(file); }
std::FILE* stream_of(int file) { return _fdopen(file, "wb"); }
int descriptor_of(std::FILE* stream) { return _fileno(stream); }
int64_t position_of(std::FILE* stream) { return _ftelli64(stream); }
bool seek_to(std::FILE* stream, int64_t position) { return _fseeki64(stream, position, SEEK_SET) == 0; }

}  // namespace raymeld
