#include "support.h"

#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <system_error>

namespace raymeld::test {

TemporaryDirectory::TemporaryDirectory() {
  std::string name = (std::filesystem::temp_directory_path() / "raymeld-test-XXXXXX").string();
  if (!mkdtemp(name.data())) throw std::system_error(errno, std::generic_category(), name);
  path_ = name;
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

bool full_extent() {
  const char* value = std::getenv("RAYMELD_TEST_EXTENT");
  const std::string extent = value ? value : "quick";
  if (extent == "full" || extent == "quick") return extent == "full";
  throw std::runtime_error("RAYMELD_TEST_EXTENT is '" + extent + "', expected quick or full");
}

bool is_tried(size_t index, size_t step) { return full_extent() || index % step == 0; }

std::filesystem::path source_path(const std::filesystem::path& relative) {
  return std::filesystem::path(RAYMELD_SOURCE_DIR) / relative;
}

}  // namespace raymeld::test
