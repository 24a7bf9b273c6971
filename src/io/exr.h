#pragma once

#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfPixelType.h>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "io/image.h"
#include "platform/atomic_file.h"
#include "platform/file_version.h"

namespace raymeld {

struct ExrChannel {
  // The name is name_in_part, but "part.channel" in a multi-part file where the part lists the channel
  // without a layer ("layer.channel") or two parts list the same name.
  std::string name;
  std::string name_in_part;  // the name in the part's channel list
  int part = 0;
  Imf::PixelType type = Imf::HALF;
  int x_sampling = 1;
  int y_sampling = 1;
};

// Holds one channel exactly as the file stores it: with its own type and sampling, all rows of the data
// window, and nothing converted.
struct ExrRawChannel {
  std::string name;
  Imf::PixelType type = Imf::HALF;
  int x_sampling = 1;
  int y_sampling = 1;
  Imath::Box2i data_window;
  std::vector<char> bytes;
};

// Returns whether `window`, a part of the channel's data window, is made of whole samples, so that it can be
// a channel of its own.
bool can_be_cropped(const ExrChannel& channel, const Imath::Box2i& window);
// Returns the samples within `window`, a part of the data window for which can_be_cropped() holds.
ExrRawChannel cropped(ExrRawChannel channel, const Imath::Box2i& window);

// Reads an OpenEXR file: scan line or tiled (the full-size level), single or multi-part, of any pixel type
// and compression. Every function throws an Error that names the file if it is missing, a folder, unreadable,
// not OpenEXR, truncated, deep, or was written to since it was opened. Pixels are read only when asked for.
class ExrFile {
 public:
  explicit ExrFile(std::filesystem::path path);
  ~ExrFile();
  ExrFile(ExrFile&&) noexcept;
  ExrFile& operator=(ExrFile&&) noexcept;

  const std::filesystem::path& path() const { return path_; }
  // Lists the channels in the order of the file: part by part, and by name in each part.
  const std::vector<ExrChannel>& channels() const { return channels_; }
  std::vector<std::string> channel_names() const;
  const ExrChannel& channel(const std::string& name) const;
  // Returns the windows, the pixel aspect ratio and all attributes of a part.
  const Imf::Header& header(int part = 0) const;

  // Returns (names.size(), H, W) over the data window, which all of the channels must share. Half and uint
  // become float. Each sample of a sub-sampled channel is repeated over the pixels that it stands for.
  Image read(std::span<const std::string> names);
  ExrRawChannel read_raw(const std::string& name);

 private:
  template <typename Work>
  auto reading(Work&& work) const;

  std::filesystem::path path_;
  FileVersion version_;
  std::unique_ptr<Imf::MultiPartInputFile> file_;
  std::vector<ExrChannel> channels_;
};

// Describes a channel to write from floats, (H, W) over the data window; `type` is HALF or FLOAT.
struct ExrPlane {
  std::string name;
  Imf::PixelType type = Imf::HALF;
  const float* pixels = nullptr;
};

struct ExrOutput {
  // The windows, the pixel aspect ratio and the attributes are those of this header, an input file's own.
  // Attributes that would be wrong for the output (channels, tiles, preview, names of layers that are not
  // written) are dropped.
  Imf::Header source;
  Imf::Compression compression = Imf::ZIP_COMPRESSION;
  std::vector<ExrPlane> planes;
  // These channels are copied bit by bit, which needs a lossless compression.
  std::vector<ExrRawChannel> pass_through;
};

// Writes a single-part scan-line file, whole or not at all. Values of half planes are clamped to
// +-kLargestHalf; returns how many were. Throws an Error that names the file.
size_t write_exr(const std::filesystem::path& path, const ExrOutput& output);
// Does the same without commit().
size_t write_exr(AtomicFile& file, const ExrOutput& output);

// Returns `header` with the windows of an image that keeps one of every scale x scale pixels. The data window
// and the display window start at their old origins divided by `scale`, rounded down.
Imf::Header degraded_header(const Imf::Header& header, int scale);

}  // namespace raymeld
