// What an OpenEXR file claims of its own size, held against the size that it has: OpenEXR allocates first and
// reads then.
#pragma once

#include <OpenEXR/ImfMultiPartInputFile.h>

#include <filesystem>

namespace raymeld {

// Throws Error for an attribute that is longer than the file, or not as long as its type is.
void check_attribute_sizes(const std::filesystem::path& path);

// Throws Error where the images of all parts are far larger than what a file of that size may become when it
// is decompressed, or where a tile is larger than its image and than 256 MiB.
void check_image_sizes(const std::filesystem::path& path, const Imf::MultiPartInputFile& file);

}  // namespace raymeld
