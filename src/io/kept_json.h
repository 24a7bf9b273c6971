// What raymeld measures once and keeps in a folder of its own, in files that anyone may edit or delete.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace raymeld {

// null where the file is absent, larger than 16 MiB or no JSON, or has another format_version.
nlohmann::ordered_json load_kept(const std::filesystem::path& file, int format_version);

// As an AtomicFile, with its format_version; makes the folder. Throws Error.
void save_kept(const std::filesystem::path& file, int format_version, const nlohmann::ordered_json& content);

}  // namespace raymeld
