#include "io/input_file.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "error.h"

namespace raymeld {

void check_input_file(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found)
    throw Error("cannot read '{}': there is no such file", path.string());
  if (error) throw Error("cannot read '{}': {}", path.string(), error.message());
  if (std::filesystem::is_directory(status)) throw Error("cannot read '{}': it is a folder", path.string());
  if (!std::filesystem::is_regular_file(status))
    throw Error("cannot read '{}': it is not a regular file", path.string());
  // eaccess() checks for the effective user, as open() does.
  if (eaccess(path.c_str(), R_OK) != 0)
    throw Error("cannot read '{}': {}", path.string(), std::strerror(errno));
}

FileVersion::FileVersion(const std::filesystem::path& path) {
  struct stat now {};
  if (stat(path.c_str(), &now) != 0) return;
  device_ = now.st_dev, inode_ = now.st_ino, size_bytes_ = uint64_t(now.st_size);
  seconds_ = now.st_mtim.tv_sec, nanoseconds_ = now.st_mtim.tv_nsec;
}

void FileVersion::check(const std::filesystem::path& path) const {
  const FileVersion now(path);
  if (now.device_ != device_ || now.inode_ != inode_) return;
  if (now.size_bytes_ == size_bytes_ && now.seconds_ == seconds_ && now.nanoseconds_ == nanoseconds_) return;
  throw Error("cannot read '{}': it was written to while it was being read", path.string());
}

}  // namespace raymeld
