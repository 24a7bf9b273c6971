// Reads and writes the measurements that raymeld keeps in a folder of its own. Anyone may edit or delete
// these files.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace raymeld {

// Returns null if the file is absent, larger than 16 MiB or not JSON, or has another format_version.
nlohmann::ordered_json load_json_file(const std::filesystem::path& file, int format_version);

// Writes `content` and its format_version as an AtomicFile. Makes the folder. Throws Error.
void save_json_file(const std::filesystem::path& file, int format_version,
                    const nlohmann::ordered_json& content);

}  // namespace raymeld
