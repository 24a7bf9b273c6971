#include "cli/models.h"

#include <fmt/ranges.h>

#include <cstdlib>
#include <set>
#include <vector>

#include "error.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;
constexpr const char* kExtension = ".safetensors";

std::vector<fs::path> folders() {
  std::vector<fs::path> result;
  if (const char* chosen = std::getenv("RAYMELD_MODELS"); chosen && *chosen) result.push_back(chosen);
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (!error) result.push_back(program.parent_path().parent_path() / "share/raymeld/models");
  result.push_back(RAYMELD_MODEL_DIR);
  return result;
}

fs::path find_name(const std::string& name) {
  std::error_code error;
  for (const fs::path& folder : folders()) {
    const fs::path file = folder / (name + kExtension);
    if (fs::is_regular_file(file, error)) return file;
  }
  return {};
}

fs::path find_default(const std::string& scale) {
  for (const char* size : {"balanced", "fast", "full"}) {
    if (const fs::path file = find_name(scale + "-" + size); !file.empty()) return file;
  }
  return {};
}

std::set<std::string> names() {
  std::set<std::string> result;
  std::error_code error;
  for (const fs::path& folder : folders()) {
    for (const auto& entry : fs::directory_iterator(folder, error)) {
      if (entry.path().extension() == kExtension) result.insert(entry.path().stem().string());
    }
  }
  return result;
}

std::string what_there_is() {
  std::vector<std::string> searched;
  for (const fs::path& folder : folders()) searched.push_back(folder.string());
  return names().empty() ? fmt::format("there are none in {}", fmt::join(searched, ", "))
                         : fmt::format("there are {}", fmt::join(names(), ", "));
}

}  // namespace

fs::path find_model(const std::string& wanted) {
  if (wanted.find('/') != std::string::npos || wanted.ends_with(kExtension)) return wanted;
  for (const fs::path& file : {find_name(wanted), find_default(wanted)}) {
    if (!file.empty()) return file;
  }
  if (std::error_code error; fs::is_regular_file(wanted, error)) return wanted;
  throw Error("there is no model '{}', neither by name nor as a file; {}", wanted, what_there_is());
}

fs::path default_model(int scale) {
  const fs::path file = find_default(fmt::format("x{}", scale));
  if (file.empty()) throw Error("there is no model for scale {}; {}", scale, what_there_is());
  return file;
}

std::shared_ptr<const Model> LastModel::load(const fs::path& file) {
  if (!model_ || file != file_) model_ = std::make_shared<const Model>(file);
  file_ = file;
  return model_;
}

}  // namespace raymeld::cli
