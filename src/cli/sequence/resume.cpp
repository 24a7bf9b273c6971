// Decides which frames --resume skips.
#include "cli/sequence/sequence.h"

namespace raymeld::cli {

namespace fs = std::filesystem;

std::optional<FileTime> newest_input(const FuseArguments& frame) {
  FileTime newest = FileTime::min();
  for (const fs::path& input : frame.inputs()) {
    std::error_code error;
    newest = std::max(newest, fs::last_write_time(input, error));
    if (error) return std::nullopt;
  }
  return newest;
}

bool is_done(const FuseArguments& frame, FileTime since) {
  std::vector<fs::path> outputs = frame.outputs();
  if (!frame.dump.empty()) outputs.push_back(frame.last_dumped());
  return !outputs.empty() && std::ranges::all_of(outputs, [&](const fs::path& output) {
    std::error_code error;
    const FileTime written = fs::last_write_time(output, error);
    return !error && fs::is_regular_file(output, error) && written >= since;
  });
}

}  // namespace raymeld::cli
