// Compares the sizes that an OpenEXR file claims with the size that it has, as OpenEXR allocates memory
// before it reads.
#pragma once

#include <OpenEXR/ImfMultiPartInputFile.h>

#include <filesystem>

namespace raymeld {

// Throws Error for an attribute that is longer than the file, or whose length is not that of its type.
void check_attribute_sizes(const std::filesystem::path& path);

// Throws Error when the images of all parts are far larger than a file of that size can decompress to, or
// when a tile is larger than its image and than 256 MiB.
void check_image_sizes(const std::filesystem::path& path, const Imf::MultiPartInputFile& file);

}  // namespace raymeld
