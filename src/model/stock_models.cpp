#include "model/stock_models.h"

#include <dlfcn.h>
#include <fmt/ranges.h>
#include <link.h>

#include <algorithm>
#include <cstdlib>
#include <set>

#include "error.h"

namespace raymeld {
namespace {

namespace fs = std::filesystem;
constexpr const char* kExtension = ".safetensors";

// Holds the library or program that this code is part of, and the path of the stock models from its folder.
struct Home {
  fs::path file;  // empty if unknown
  fs::path models;
};

Home find_home() {
  Dl_info info;
  void* loaded = nullptr;
  const auto here = reinterpret_cast<const void*>(&find_home);
  if (!dladdr1(here, &info, &loaded, RTLD_DL_LINKMAP)) return {};
  std::error_code error;
  const char* library = static_cast<const link_map*>(loaded)->l_name;  // "" stands for the program
  if (*library) return {fs::canonical(library, error), RAYMELD_MODELS_FROM_LIBRARY};
  return {fs::read_symlink("/proc/self/exe", error), RAYMELD_MODELS_FROM_PROGRAM};
}

bool is_within(const fs::path& file, const fs::path& folder) {
  return std::ranges::mismatch(folder, file).in1 == folder.end();
}

}  // namespace

std::vector<fs::path> model_folders() {
  std::vector<fs::path> folders;
  if (const char* chosen = std::getenv("RAYMELD_MODELS"); chosen && *chosen) folders.push_back(chosen);
  static const Home home = find_home();
  if (home.file.empty()) return folders;
  folders.push_back((home.file.parent_path() / home.models).lexically_normal());
  std::error_code error;
  const fs::path built = fs::canonical(RAYMELD_BUILD_DIR, error);
  if (!error && is_within(home.file, built)) folders.push_back(RAYMELD_SOURCE_MODELS);
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
  if (wanted.find('/') != std::string::npos || wanted.ends_with(kExtension)) return wanted;
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
