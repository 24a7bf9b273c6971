#include "cli/fuse/fuse.h"

namespace raymeld::cli {

namespace fs = std::filesystem;

std::vector<fs::path> FuseArguments::inputs() const {
  std::vector<fs::path> paths;
  for (const std::string& path : {hrls, lrhs, guides, reference}) {
    if (!path.empty()) paths.push_back(path);
  }
  return paths;
}

std::vector<fs::path> FuseArguments::outputs() const {
  std::vector<fs::path> paths;
  for (const std::string& path : {output, preview, before_after}) {
    if (!path.empty()) paths.push_back(path);
  }
  return paths;
}

fs::path FuseArguments::dump_folder() const {
  const fs::path folder = dump;
  return folder.has_filename() ? folder : folder.parent_path();
}

fs::path FuseArguments::last_dumped() const { return dump_folder() / "decode.npy"; }

}  // namespace raymeld::cli
