// Stands between a program and the disk (LD_PRELOAD). It reads the environment:
//   RAYMELD_SYNC_LOG=FILE          gets a line "sync INODE" for each fsync that is done, and a line
//                                  "name INODE FOLDER PATH" for each name that a file is given; FOLDER is
//                                  the inode of its folder
//   RAYMELD_HOLD_SYNC="PART FILE"  makes the fsync of a file whose path holds PART wait until FILE exists
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <sstream>
#include <string>

#include "../support/gate.h"

namespace {

template <typename Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

ino_t inode_of(const std::string& path) {
  struct stat status {};
  return stat(path.c_str(), &status) == 0 ? status.st_ino : 0;
}

std::string path_of(int file) { return "/proc/self/fd/" + std::to_string(file); }

void log(const std::string& line) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  if (const char* file = std::getenv("RAYMELD_SYNC_LOG"))
    std::ofstream(file, std::ios::app) << line << std::endl;
}

void log_name(ino_t inode, const char* path) {
  const std::string folder = std::filesystem::absolute(path).parent_path();
  log("name " + std::to_string(inode) + " " + std::to_string(inode_of(folder)) + " " + path);
}

void hold_back(int file) {
  const char* text = std::getenv("RAYMELD_HOLD_SYNC");
  if (!text) return;
  std::string part, gate;
  std::istringstream(text) >> part >> gate;
  std::error_code error;
  const std::string path = std::filesystem::read_symlink(path_of(file), error);
  if (path.find(part) != std::string::npos) raymeld::test::wait_for_file(gate);
}

}  // namespace

extern "C" __attribute__((visibility("default"))) int fsync(int file) {
  hold_back(file);
  const int result = next<int (*)(int)>("fsync")(file);
  if (result == 0) log("sync " + std::to_string(inode_of(path_of(file))));
  return result;
}

extern "C" __attribute__((visibility("default"))) int rename(const char* from, const char* to) noexcept {
  const ino_t inode = inode_of(from);
  const int result = next<int (*)(const char*, const char*)>("rename")(from, to);
  if (result == 0) log_name(inode, to);
  return result;
}

extern "C" __attribute__((visibility("default"))) int linkat(int from_folder, const char* from, int to_folder,
                                                             const char* to, int flags) noexcept {
  const ino_t inode = inode_of(from);
  const int result = next<decltype(&linkat)>("linkat")(from_folder, from, to_folder, to, flags);
  if (result == 0) log_name(inode, to);
  return result;
}
