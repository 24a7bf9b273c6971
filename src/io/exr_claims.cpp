#include "io/exr_claims.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfVersion.h>

#include <algorithm>
#include <bit>
#include <fstream>
#include <map>
#include <string>

#include "error.h"
#include "io/exr_window.h"
#include "numbers.h"

namespace raymeld {
namespace {

static_assert(std::endian::native == std::endian::little, "the format is little endian");

// Holds how many bytes OpenEXR reads for these types, whatever size the file gives. For other types it reads
// the size that the file gives.
const std::map<std::string_view, uint32_t> kFixedSizes{{"box2f", 16},
                                                       {"box2i", 16},
                                                       {"chromaticities", 32},
                                                       {"compression", 1},
                                                       {"deepImageState", 1},
                                                       {"double", 8},
                                                       {"envmap", 1},
                                                       {"float", 4},
                                                       {"int", 4},
                                                       {"keycode", 28},
                                                       {"lineOrder", 1},
                                                       {"m33d", 72},
                                                       {"m33f", 36},
                                                       {"m44d", 128},
                                                       {"m44f", 64},
                                                       {"rational", 8},
                                                       {"tiledesc", 9},
                                                       {"timecode", 8},
                                                       {"v2d", 16},
                                                       {"v2f", 8},
                                                       {"v2i", 8},
                                                       {"v3d", 24},
                                                       {"v3f", 12},
                                                       {"v3i", 12}};

// Walks over all headers, attribute by attribute: name, type, size, value.
class HeaderWalk {
 public:
  explicit HeaderWalk(const std::filesystem::path& path)
      : path_(path), stream_(path, std::ios::binary), file_bytes_(std::filesystem::file_size(path)) {}

  void check() {
    stream_.seekg(4);  // skips the magic number
    const uint32_t version = read_uint32();
    if (!Imf::isMultiPart(int(version))) {
      check_header();
    } else {
      while (check_header()) continue;  // an empty header is the last
    }
  }

 private:
  // Checks one header, and returns whether it has attributes.
  bool check_header() {
    bool any = false;
    for (std::string name = read_text(); !name.empty(); name = read_text(), any = true) {
      const std::string type = read_text();
      const uint32_t size_bytes = read_uint32();
      const uint64_t begin = position(), end = begin + size_bytes;
      if (end > file_bytes_)
        fail("its attribute '{}' claims {} bytes, which is more than the file has", name, size_bytes);
      if (!has_size(type, end))
        fail("its attribute '{}' of type {} claims {} bytes, which its type does not allow", name, type,
             size_bytes);
    }
    return any;
  }

  // Moves past a value of `type`, and returns whether it ends at `end`.
  bool has_size(const std::string& type, uint64_t end) {
    const uint64_t begin = position();
    if (type == "chlist") {
      constexpr uint32_t kChannelBytes = 16;
      while (!read_text().empty()) skip_to(position() + kChannelBytes);
    } else if (type == "stringvector") {
      while (position() < end) {
        const uint32_t length = read_uint32();
        skip_to(position() + length);
      }
    } else if (type == "preview") {
      const uint64_t width = read_uint32(), height = read_uint32();
      constexpr uint64_t kPixelBytes = 4;
      if (height > 0 && width > file_bytes_ / height) return false;
      skip_to(position() + kPixelBytes * width * height);
    } else if (type == "floatvector") {
      skip_to(end - (end - begin) % sizeof(float));
    } else if (const auto fixed = kFixedSizes.find(type); fixed != kFixedSizes.end()) {
      skip_to(begin + fixed->second);
    } else {
      skip_to(end);
    }
    return position() == end;
  }

  std::string read_text() {
    std::string text;
    std::getline(stream_, text, '\0');
    check_stream();
    return text;
  }

  uint32_t read_uint32() {
    uint32_t value = 0;
    stream_.read(reinterpret_cast<char*>(&value), sizeof(value));
    check_stream();
    return value;
  }

  uint64_t position() { return uint64_t(stream_.tellg()); }

  void skip_to(uint64_t position) {
    stream_.seekg(std::streamoff(position));
    check_stream();
  }

  void check_stream() const {
    if (!stream_.good()) fail("it ends within its header");
  }

  template <typename... Args>
  [[noreturn]] void fail(fmt::format_string<Args...> format, Args&&... args) const {
    throw Error("cannot read '{}': {}", path_.string(), fmt::format(format, std::forward<Args>(args)...));
  }

  const std::filesystem::path& path_;
  std::ifstream stream_;
  uint64_t file_bytes_;
};

// Returns how many times as large as their file pixels may become. This is at least twice the figure for
// black images: 2,041 with the lossless codecs, 35,203 with DWAB.
double most_expansion(Imf::Compression compression) {
  return compression == Imf::DWAA_COMPRESSION || compression == Imf::DWAB_COMPRESSION ? 1 << 17 : 1 << 12;
}

double channels_of(const Imf::Header& header) {
  double count = 0;
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) ++count;
  return count;
}

// Counts every value as a float, the type it is read as.
double pixel_bytes(const Imf::Header& header) {
  const Imath::Box2i& window = header.dataWindow();
  return double(width_of(window)) * height_of(window) * channels_of(header) * sizeof(float);
}

std::string size_text(const Imf::Header& header) {
  const Imath::Box2i& window = header.dataWindow();
  return fmt::format("{} x {} pixels of {} channels", width_of(window), height_of(window),
                     channels_of(header));
}

}  // namespace

void check_attribute_sizes(const std::filesystem::path& path) { HeaderWalk(path).check(); }

void check_image_sizes(const std::filesystem::path& path, const Imf::MultiPartInputFile& file) {
  constexpr double kMostTileBytes = 256 * kMebibyte;
  const auto file_bytes = double(std::filesystem::file_size(path));
  double least_bytes = 0;  // the least that the parts up to this one take in the file
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    least_bytes += pixel_bytes(header) / most_expansion(header.compression());
    if (least_bytes > file_bytes)
      throw Error("cannot read '{}': {} cannot be in a file of {} bytes", path.string(),
                  part == 0 ? size_text(header) : fmt::format("its parts up to part {}", part), file_bytes);
    if (!header.hasTileDescription()) continue;
    const Imf::TileDescription& tile = header.tileDescription();
    const double tile_bytes = double(tile.xSize) * tile.ySize * channels_of(header) * sizeof(float);
    if (tile_bytes > std::max(kMostTileBytes, pixel_bytes(header)))
      throw Error("cannot read '{}': its tiles of {} x {} pixels are larger than the image", path.string(),
                  tile.xSize, tile.ySize);
  }
}

}  // namespace raymeld
