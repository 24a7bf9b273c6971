#include "networks/stock_models.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <set>

#include "error.h"
#include "platform/folders.h"

namespace raymeld {
namespace {

namespace fs = std::filesystem;
constexpr const char* kExtension = ".safetensors";

bool is_within(const fs::path& file, const fs::path& folder) {
  return std::ranges::mismatch(folder, file).in1 == folder.end();
}

}  // namespace

std::vector<fs::path> model_folders() {
  std::vector<fs::path> folders;
  if (const char* chosen = std::getenv("RAYMELD_MODELS"); chosen && *chosen) folders.push_back(chosen);
  static const OwnFile own = own_file();
  if (own.path.empty()) return folders;
  const fs::path from_here = own.is_library ? RAYMELD_MODELS_FROM_LIBRARY : RAYMELD_MODELS_FROM_PROGRAM;
  folders.push_back((own.path.parent_path() / from_here).lexically_normal());
  std::error_code error;
  const fs::path built = fs::canonical(RAYMELD_BUILD_DIR, error);
  if (!error && is_within(own.path, built)) folders.push_back(RAYMELD_SOURCE_MODELS);
  return folders;
}

std::vector<std::string> stock_models() {
  std::set<std::string> names;
  std::error_code error;
  for (const fs::path& folder : model_folders()) {
    for (const auto& entry : fs::directory_iterator(folder, error)) {
      if (entry.path().extension() == kExtension && entry.is_regular_file(error))
        names.insert(entry.path().stem().string());
    }
  }
  return {names.begin(), names.end()};
}

fs::path find_stock_model(const std::string& name) {
  std::error_code error;
  for (const fs::path& folder : model_folders()) {
    const fs::path file = folder / (name + kExtension);
    if (fs::is_regular_file(file, error)) return file;
  }
  return {};
}

fs::path model_file(const std::string& wanted) {
  if (fs::path(wanted).has_parent_path() || wanted.ends_with(kExtension)) return wanted;
  if (std::error_code error; fs::is_regular_file(wanted, error)) return wanted;
  if (const fs::path file = find_stock_model(wanted); !file.empty()) return file;
  throw Error("there is no model '{}', neither by name nor as a file; {}", wanted, what_models_there_are());
}

std::string what_models_there_are() {
  const std::vector<std::string> names = stock_models();
  std::vector<std::string> folders;
  for (const fs::path& folder : model_folders()) folders.push_back(folder.string());
  return fmt::format("there are {} in {}", names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", ")),
                     fmt::join(folders, ", "));
}

}  // namespace raymeld
