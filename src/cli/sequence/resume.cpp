// Decides which frames --resume skips.
#include "cli/sequence/sequence.h"

namespace raymeld::cli {

namespace fs = std::filesystem;

bool is_done(const FuseArguments& frame, const fs::path& model) {
  std::vector<fs::path> inputs = frame.inputs(), outputs = frame.outputs();
  if (!model.empty()) inputs.push_back(model);
  if (!frame.dump.empty()) outputs.push_back(frame.last_dumped());
  std::error_code error;
  fs::file_time_type newest_input = fs::file_time_type::min(), oldest_output = fs::file_time_type::max();
  for (const fs::path& input : inputs) {
    newest_input = std::max(newest_input, fs::last_write_time(input, error));
    if (error) return false;
  }
  for (const fs::path& output : outputs) {
    oldest_output = std::min(oldest_output, fs::last_write_time(output, error));
    if (error || !fs::is_regular_file(output, error)) return false;
  }
  return !outputs.empty() && oldest_output >= newest_input;
}

}  // namespace raymeld::cli
