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

#include "platform/atomic_file.h"
#include "io/image.h"
#include "io/input_file.h"

namespace raymeld {

struct ExrChannel {
  // In a multi-part file "part.channel" when the part's channel list gives no layer ("layer.channel"), or
  // when two parts give the same.
  std::string name;
  std::string name_in_part;  // as it stands in the part's channel list
  int part = 0;
  Imf::PixelType type = Imf::HALF;
  int x_sampling = 1;
  int y_sampling = 1;
};

// One channel exactly as the file stores it: own type and sampling, rows of the data window, nothing
// converted.
struct ExrRawChannel {
  std::string name;
  Imf::PixelType type = Imf::HALF;
  int x_sampling = 1;
  int y_sampling = 1;
  Imath::Box2i data_window;
  std::vector<char> bytes;
};

// Whether a part of a channel's data window can be a channel of its own: whole samples.
bool can_be_cropped(const ExrChannel& channel, const Imath::Box2i& window);
// The samples within `window`, a part of the data window that can_be_cropped().
ExrRawChannel cropped(ExrRawChannel channel, const Imath::Box2i& window);

// An open OpenEXR file: scan line or tiled (the full-size level), single or multi-part, any pixel type and
// compression. Every function throws Error, naming the file: missing, a folder, unreadable, no OpenEXR,
// truncated, deep, written to since it was opened. Pixels are read only when asked for.
class ExrFile {
 public:
  explicit ExrFile(std::filesystem::path path);
  ~ExrFile();
  ExrFile(ExrFile&&) noexcept;
  ExrFile& operator=(ExrFile&&) noexcept;

  const std::filesystem::path& path() const { return path_; }
  // In the order of the file: parts, then names.
  const std::vector<ExrChannel>& channels() const { return channels_; }
  std::vector<std::string> channel_names() const;
  const ExrChannel& channel(const std::string& name) const;
  // Windows, pixel aspect ratio and all attributes of a part.
  const Imf::Header& header(int part = 0) const;

  // (names.size(), H, W) over the data window, which all of the channels must share. Half and uint become
  // float; a sub-sampled channel repeats each sample over its cell.
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

// A channel to write from floats, (H, W) of the data window; `type` is HALF or FLOAT.
struct ExrPlane {
  std::string name;
  Imf::PixelType type = Imf::HALF;
  const float* pixels = nullptr;
};

struct ExrOutput {
  // Where the windows, the pixel aspect ratio and the attributes come from: the HRLS file's header as it is.
  // What would no longer be true of the output (channels, tiles, preview, names of layers left behind) is
  // dropped.
  Imf::Header source;
  Imf::Compression compression = Imf::ZIP_COMPRESSION;
  std::vector<ExrPlane> planes;
  // Copied bit by bit, so only together with a lossless compression.
  std::vector<ExrRawChannel> pass_through;
};

// Writes a single-part scan-line file, whole or not at all. Half planes clamp to +-kLargestHalf; the return
// value counts the values that did. Throws Error, naming the file.
size_t write_exr(const std::filesystem::path& path, const ExrOutput& output);
// The same, without commit().
size_t write_exr(AtomicFile& file, const ExrOutput& output);

// `header` with the windows of the image that keeps one pixel of every scale x scale cell: the data window
// starts at the same place divided by `scale`, rounded down, and so does the display window.
Imf::Header degraded_header(const Imf::Header& header, int scale);

}  // namespace raymeld
