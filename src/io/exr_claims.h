// What an OpenEXR file claims of its own size, held against the size that it has: OpenEXR allocates first and reads then.
#pragma once

#include <OpenEXR/ImfHeader.h>

#include <cstdint>
#include <filesystem>

namespace raymeld {

// Throws Error for an attribute that is longer than the file, or not as long as its type is.
void check_attribute_sizes(const std::filesystem::path& path);

// Throws Error for a part that is far larger than `file_bytes` could become by its compression.
void check_part_size(const std::filesystem::path& path, const OPENEXR_IMF_NAMESPACE::Header& header,
                     uint64_t file_bytes);

}  // namespace raymeld
