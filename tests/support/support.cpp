#include "support.h"

#include <fmt/format.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <regex>
#include <stdexcept>

namespace raymeld::test {

TemporaryDirectory::TemporaryDirectory() {
  std::random_device random;
  do {
    path_ = std::filesystem::temp_directory_path() / fmt::format("raymeld-test-{:08x}", random());
  } while (!std::filesystem::create_directory(path_));
}

TemporaryDirectory::~TemporaryDirectory() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

std::string read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path.string());
  std::ostringstream content;
  if (file.peek() != std::ifstream::traits_type::eof()) content << file.rdbuf();
  if (file.bad() || content.bad()) throw std::runtime_error("cannot read " + path.string());
  return std::move(content).str();
}

void write_file(const std::filesystem::path& path, std::string_view content) {
  std::ofstream file(path, std::ios::binary);
  file << content << std::flush;
  if (!file) throw std::runtime_error("cannot write " + path.string());
}

void set_variable(const char* name, const char* value) {
#ifdef _WIN32
  _putenv_s(name, value ? value : "");
#else
  value ? setenv(name, value, 1) : unsetenv(name);
#endif
}

void set_cache_home(const std::filesystem::path& folder) {
#ifdef _WIN32
  set_variable("LOCALAPPDATA", folder.string().c_str());
#else
  set_variable("XDG_CACHE_HOME", folder.c_str());
#endif
}

bool full_extent() {
  const char* value = std::getenv("RAYMELD_TEST_EXTENT");
  const std::string extent = value ? value : "quick";
  if (extent == "full" || extent == "quick") return extent == "full";
  throw std::runtime_error("RAYMELD_TEST_EXTENT is '" + extent + "', expected quick or full");
}

bool is_tried(size_t index, size_t step) { return full_extent() || index % step == 0; }

std::filesystem::path source_path(const std::filesystem::path& relative) {
  const char* moved = std::getenv("RAYMELD_TEST_SOURCE_DIR");
  return std::filesystem::path(moved ? moved : RAYMELD_SOURCE_DIR) / relative;
}

std::set<std::string> names_in(const std::filesystem::path& file, const char* pattern) {
  const std::string content = read_file(file);
  const std::regex name(pattern);
  std::set<std::string> names;
  for (std::sregex_iterator at(content.begin(), content.end(), name), end; at != end; ++at)
    names.insert((*at)[1].str());
  return names;
}

std::set<std::string> layer_names() {
  auto names = names_in(source_path("src/layers/layers.h"), R"re(\nvoid (\w+)\(Graph& graph)re");
  names.erase("conv2d_chain");  // it is conv2d() again and again
  return names;
}

}  // namespace raymeld::test
