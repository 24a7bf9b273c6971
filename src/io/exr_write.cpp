#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string_view>

#include "error.h"
#include "io/exr.h"
#include "io/exr_window.h"
#include "numbers.h"
#include "platform/atomic_file.h"

namespace raymeld {
namespace {

// These attributes describe how the source is stored, or are its preview, and would be wrong for the output.
constexpr std::array<std::string_view, 10> kNeverCopied = {
    "channels", "chunkCount", "compression", "lineOrder", "maxSamplesPerPixel",
    "name",     "preview",    "tiles",       "type",      "version"};
// These attributes are true only if the layers that they describe are written.
constexpr std::array<std::string_view, 3> kOnlyWithLayers = {"BlenderMultiChannel", "multiView",
                                                             "idManifest"};

template <typename List>
bool contains(const List& list, std::string_view name) {
  return std::ranges::find(list, name) != list.end();
}

// `cryptomatte/<id>/...` stays when the layer that `cryptomatte/<id>/name` names is written.
bool cryptomatte_is_written(const Imf::Header& source, const std::string& attribute,
                            const ExrOutput& output) {
  const std::string id = attribute.substr(0, attribute.find('/', std::string_view("cryptomatte/").size()));
  const auto* layer = source.findTypedAttribute<Imf::StringAttribute>(id + "/name");
  return layer && std::ranges::any_of(output.pass_through, [&](const ExrRawChannel& channel) {
           return channel.name.starts_with(layer->value());
         });
}

bool is_carried_over(const std::string& attribute, const ExrOutput& output) {
  if (contains(kNeverCopied, attribute)) return false;
  if (attribute.starts_with("cryptomatte/")) return cryptomatte_is_written(output.source, attribute, output);
  return !contains(kOnlyWithLayers, attribute) ||
         std::ranges::any_of(output.pass_through, [](const ExrRawChannel& channel) {
           return channel.name.find('.') != std::string::npos;
         });
}

Imf::Header output_header(const ExrOutput& output) {
  const Imf::Header& source = output.source;
  Imf::Header header(source.displayWindow(), source.dataWindow(), source.pixelAspectRatio(),
                     source.screenWindowCenter(), source.screenWindowWidth(), Imf::INCREASING_Y,
                     output.compression);
  for (auto i = source.begin(); i != source.end(); ++i)
    if (is_carried_over(i.name(), output)) header.insert(i.name(), i.attribute());
  for (const ExrPlane& plane : output.planes) header.channels().insert(plane.name, Imf::Channel(plane.type));
  for (const ExrRawChannel& raw : output.pass_through)
    header.channels().insert(raw.name, Imf::Channel(raw.type, raw.x_sampling, raw.y_sampling));
  return header;
}

bool is_lossless(Imf::Compression compression) { return compression <= Imf::PIZ_COMPRESSION; }

void check_output(const std::string& path, const ExrOutput& output) {
  std::set<std::string> names;
  for (const ExrPlane& plane : output.planes) {
    if (!names.insert(plane.name).second)
      throw Error("cannot write '{}': there are two channels '{}'", path, plane.name);
    if (plane.type == Imf::UINT)
      throw Error("cannot write '{}': channel '{}' has the type uint, expected half or float", path,
                  plane.name);
  }
  for (const ExrRawChannel& raw : output.pass_through) {
    if (!names.insert(raw.name).second)
      throw Error("cannot write '{}': there are two channels '{}'", path, raw.name);
    if (raw.data_window != output.source.dataWindow())
      throw Error(
          "cannot write '{}': channel '{}' needs the data window of the output, as it is copied unaltered",
          path, raw.name);
  }
  if (!output.pass_through.empty() && !is_lossless(output.compression))
    throw Error("cannot write '{}': channel '{}' is copied unaltered, which needs a lossless compression",
                path, output.pass_through.front().name);
}

std::vector<half> to_half(const float* pixels, size_t count, size_t& clamped) {
  std::vector<half> halves(count);
  for (size_t i = 0; i < count; ++i) {
    const float value = pixels[i];
    if (std::abs(value) > kLargestHalf) ++clamped;
    halves[i] = value > kLargestHalf ? kLargestHalf : value < -kLargestHalf ? -kLargestHalf : value;
  }
  return halves;
}

class Stream : public Imf::OStream {
 public:
  Stream(AtomicFile& file, const std::string& name) : OStream(name.c_str()), file_(file) {}
  void write(const char bytes[], int count) override { file_.write(bytes, size_t(count)); }
  uint64_t tellp() override { return file_.position(); }
  void seekp(uint64_t position) override { file_.seek(position); }

 private:
  AtomicFile& file_;
};

// Holds the converted planes that are written as half, and the slices of all channels.
struct Frame {
  std::vector<std::vector<half>> halves;
  Imf::FrameBuffer buffer;
  size_t clamped = 0;
};

Frame make_frame(const ExrOutput& output) {
  const Imath::Box2i window = output.source.dataWindow();
  const size_t pixels_per_plane = size_t(width_of(window)) * size_t(height_of(window));
  Frame frame;
  for (const ExrPlane& plane : output.planes) {
    const void* pixels = plane.pixels;
    if (plane.type == Imf::HALF)
      pixels = frame.halves.emplace_back(to_half(plane.pixels, pixels_per_plane, frame.clamped)).data();
    frame.buffer.insert(plane.name, Imf::Slice::Make(plane.type, pixels, window));
  }
  for (const ExrRawChannel& raw : output.pass_through) {
    const size_t pixel_bytes = size_bytes_of(raw.type);
    const size_t row_bytes = pixel_bytes * size_t(width_of(window) / raw.x_sampling);
    frame.buffer.insert(raw.name, Imf::Slice::Make(raw.type, raw.bytes.data(), window, pixel_bytes, row_bytes,
                                                   raw.x_sampling, raw.y_sampling));
  }
  return frame;
}

Imath::Box2i degraded_window(const Imath::Box2i& window, int scale) {
  const Imath::V2i origin(divide_down(window.min.x, scale), divide_down(window.min.y, scale));
  const Imath::V2i last_pixel(width_of(window) / scale - 1, height_of(window) / scale - 1);
  return {origin, origin + Imath::V2i(std::max(last_pixel.x, 0), std::max(last_pixel.y, 0))};
}

}  // namespace

size_t write_exr(const std::filesystem::path& path, const ExrOutput& output) {
  AtomicFile file(path);
  const size_t clamped = write_exr(file, output);
  file.commit();
  return clamped;
}

size_t write_exr(AtomicFile& file, const ExrOutput& output) try {
  check_output(file.path().string(), output);
  const Frame frame = make_frame(output);
  Stream stream(file, file.path().string());
  {
    // The destructor of `exr` completes the file and swallows errors, which AtomicFile::finish() reports.
    Imf::OutputFile exr(stream, output_header(output));
    exr.setFrameBuffer(frame.buffer);
    exr.writePixels(height_of(output.source.dataWindow()));
  }
  return frame.clamped;
} catch (const Error&) {
  throw;
} catch (const std::exception& error) {
  throw Error("cannot write '{}': {}", file.path().string(), error.what());
}

Imf::Header degraded_header(const Imf::Header& header, int scale) {
  Imf::Header low = header;
  low.dataWindow() = degraded_window(header.dataWindow(), scale);
  low.displayWindow() = degraded_window(header.displayWindow(), scale);
  return low;
}

}  // namespace raymeld
