#include "io/json_file.h"

#include <fstream>

#include "platform/atomic_file.h"

namespace raymeld {
namespace {

using Json = nlohmann::ordered_json;

constexpr uintmax_t kMostFileBytes = 16 << 20;

}  // namespace

Json load_json_file(const std::filesystem::path& file, int format_version) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error) || std::filesystem::file_size(file) > kMostFileBytes)
    return {};
  std::ifstream stream(file);
  Json json = Json::parse(stream, nullptr, false);
  const auto version = json.is_object() ? json.find("format_version") : json.end();
  return version != json.end() && *version == format_version ? json : Json();
}

void save_json_file(const std::filesystem::path& file, int format_version, const Json& content) {
  Json json{{"format_version", format_version}};
  json.update(content);
  std::error_code error;
  std::filesystem::create_directories(file.parent_path(), error);
  write_whole(file, json.dump(1) + "\n");
}

}  // namespace raymeld
