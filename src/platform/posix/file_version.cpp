#include "platform/file_version.h"

#include <sys/stat.h>

#include "error.h"

namespace raymeld {

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
