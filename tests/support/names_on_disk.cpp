#include "names_on_disk.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

namespace raymeld::test {

std::set<std::string> names_on_disk(const std::string& log) {
  std::set<std::string> synced, names, folders_to_sync;
  std::istringstream stream(log);
  for (std::string what, inode, folder, path; stream >> what >> inode;) {
    if (what == "sync") {
      synced.insert(inode);
      folders_to_sync.erase(inode);
      continue;
    }
    stream >> folder >> path;
    EXPECT_TRUE(synced.contains(inode)) << path << " in\n" << log;
    folders_to_sync.insert(folder);
    names.insert(std::filesystem::path(path).filename());
  }
  EXPECT_TRUE(folders_to_sync.empty()) << log;
  return names;
}

}  // namespace raymeld::test
