#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTestFile.h>

#include <algorithm>
#include <map>
#include <new>

#include "error.h"
#include "io/exr.h"
#include "io/exr_claims.h"
#include "io/exr_window.h"
#include "io/input_file.h"

namespace raymeld {
namespace {

// OpenEXR's messages open with the file's name, which raymeld's messages already give.
std::string reason(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error)) return "there is not enough memory";
  const std::string text = error.what();
  const size_t end_of_name = text.rfind("\". ");
  return end_of_name == std::string::npos ? text : text.substr(end_of_name + 3);
}

std::string full_name(const std::string& part, const std::string& channel) {
  return part.empty() || channel.starts_with(part + ".") ? channel : part + "." + channel;
}

std::string part_label(const Imf::Header& header, int part) {
  return header.hasName() ? fmt::format("part '{}'", header.name()) : fmt::format("part {}", part);
}

void check_part(const std::filesystem::path& path, const Imf::MultiPartInputFile& file, int part) {
  const Imf::Header& header = file.header(part);
  if (header.hasType() && Imf::isDeepData(header.type()))
    throw Error("cannot read '{}': {} is a deep image, and only flat images can be fused; flatten it first",
                path.string(), part_label(header, part));
  if (!file.partComplete(part))
    throw Error("cannot read '{}': {} is truncated, or was never finished", path.string(),
                part_label(header, part));
  const Imf::ChannelList& channels = header.channels();
  for (auto i = channels.begin(); i != channels.end(); ++i) {
    if (i.channel().xSampling < 1 || i.channel().ySampling < 1)
      throw Error("cannot read '{}': channel '{}' has a sampling of {} x {}, expected at least 1",
                  path.string(), i.name(), i.channel().xSampling, i.channel().ySampling);
  }
}

// Some writers name parts after layers. Others name parts freely, and give channels whole names such as
// `ViewLayer.Combined.R`.
std::vector<ExrChannel> list_channels(const Imf::MultiPartInputFile& file) {
  const auto name_with_part = [&](int part, const std::string& channel) {
    const Imf::Header& header = file.header(part);
    return full_name(file.parts() > 1 && header.hasName() ? header.name() : "", channel);
  };
  std::vector<ExrChannel> channels;
  std::map<std::string, int> uses;
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::ChannelList& list = file.header(part).channels();
    for (auto i = list.begin(); i != list.end(); ++i) {
      const std::string name = i.name();
      const Imf::Channel& channel = i.channel();
      channels.push_back({name.find('.') == std::string::npos ? name_with_part(part, name) : name, name, part,
                          channel.type, channel.xSampling, channel.ySampling});
      ++uses[channels.back().name];
    }
  }
  for (ExrChannel& channel : channels)
    if (uses.at(channel.name) > 1) channel.name = name_with_part(channel.part, channel.name_in_part);
  return channels;
}

// OpenEXR demands that a window's origin and size are multiples of the sampling.
size_t sample_count(const ExrChannel& channel, const Imath::Box2i& window) {
  return size_t(width_of(window) / channel.x_sampling) * size_t(height_of(window) / channel.y_sampling);
}

Imf::Slice slice(const ExrChannel& channel, Imf::PixelType type, char* pixels, const Imath::Box2i& window) {
  const size_t row = size_t(width_of(window) / channel.x_sampling);
  return Imf::Slice::Make(type, pixels, window, size_bytes_of(type), size_bytes_of(type) * row,
                          channel.x_sampling, channel.y_sampling);
}

void repeat_samples(const ExrChannel& channel, const std::vector<float>& samples, Image& image, int c) {
  const size_t row = size_t(image.width / channel.x_sampling);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      image.at(c, y, x) = samples[size_t(y / channel.y_sampling) * row + size_t(x / channel.x_sampling)];
}

// Reads the channels of one part into the planes of `image` that `planes` gives for them.
void read_part(Imf::MultiPartInputFile& file, const std::map<const ExrChannel*, int>& planes, int part,
               Image& image) {
  const Imath::Box2i window = file.header(part).dataWindow();
  Imf::FrameBuffer frame;
  std::map<const ExrChannel*, std::vector<float>> subsampled;
  for (const auto& [channel, c] : planes) {
    if (channel->part != part) continue;
    float* pixels = image.plane(c);
    if (channel->x_sampling != 1 || channel->y_sampling != 1) {
      subsampled[channel].resize(sample_count(*channel, window));
      pixels = subsampled[channel].data();
    }
    frame.insert(channel->name_in_part, slice(*channel, Imf::FLOAT, reinterpret_cast<char*>(pixels), window));
  }
  Imf::InputPart input(file, part);
  input.setFrameBuffer(frame);
  input.readPixels(window.min.y, window.max.y);
  for (const auto& [channel, samples] : subsampled)
    repeat_samples(*channel, samples, image, planes.at(channel));
}

}  // namespace

bool can_be_cropped(const ExrChannel& channel, const Imath::Box2i& window) {
  const auto [x, y] = std::pair(channel.x_sampling, channel.y_sampling);
  return window.min.x % x == 0 && window.min.y % y == 0 && width_of(window) % x == 0 &&
         height_of(window) % y == 0;
}

ExrRawChannel cropped(ExrRawChannel channel, const Imath::Box2i& window) {
  if (window == channel.data_window) return channel;
  const auto [x, y] = std::pair(channel.x_sampling, channel.y_sampling);
  const size_t sample = size_bytes_of(channel.type), row = sample * size_t(width_of(window) / x);
  const size_t full_row = sample * size_t(width_of(channel.data_window) / x);
  const auto first = sample * size_t((window.min.x - channel.data_window.min.x) / x);
  const auto first_row = size_t((window.min.y - channel.data_window.min.y) / y);
  std::vector<char> bytes(row * size_t(height_of(window) / y));
  for (size_t i = 0; i * row < bytes.size(); ++i)
    std::copy_n(&channel.bytes[(first_row + i) * full_row + first], row, &bytes[i * row]);
  channel.data_window = window;
  channel.bytes = std::move(bytes);
  return channel;
}

// Runs `work`, and turns OpenEXR's exceptions into Errors that name the file. Also throws an Error if the
// file changed meanwhile, which OpenEXR may not notice.
template <typename Work>
auto ExrFile::reading(Work&& work) const {
  try {
    auto result = work();
    version_.check(path_);
    return result;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    version_.check(path_);
    throw Error("cannot read '{}': {}", path_.string(), reason(error));
  }
}

ExrFile::ExrFile(std::filesystem::path path) : path_(std::move(path)), version_(path_) {
  check_input_file(path_);
  if (!Imf::isOpenExrFile(path_.c_str()))
    throw Error("cannot read '{}': it is not an OpenEXR file", path_.string());
  channels_ = reading([&] {
    check_attribute_sizes(path_);
    // A file whose chunk table is unfinished is refused, so there is no need to rebuild the table.
    file_ = std::make_unique<Imf::MultiPartInputFile>(path_.c_str(), Imf::globalThreadCount(), false);
    for (int part = 0; part < file_->parts(); ++part) check_part(path_, *file_, part);
    check_image_sizes(path_, *file_);
    return list_channels(*file_);
  });
}

ExrFile::~ExrFile() = default;
ExrFile::ExrFile(ExrFile&&) noexcept = default;
ExrFile& ExrFile::operator=(ExrFile&&) noexcept = default;

std::vector<std::string> ExrFile::channel_names() const {
  std::vector<std::string> names;
  for (const ExrChannel& channel : channels_) names.push_back(channel.name);
  return names;
}

const ExrChannel& ExrFile::channel(const std::string& name) const {
  const auto found = std::ranges::find(channels_, name, &ExrChannel::name);
  if (found == channels_.end()) throw Error("cannot read '{}': it has no channel '{}'", path_.string(), name);
  return *found;
}

const Imf::Header& ExrFile::header(int part) const { return file_->header(part); }

Image ExrFile::read(std::span<const std::string> names) {
  if (names.empty()) throw Error("cannot read '{}': no channel was asked for", path_.string());
  const ExrChannel& first = channel(names.front());
  const Imath::Box2i window = header(first.part).dataWindow();
  std::map<const ExrChannel*, int> planes;
  std::map<int, int> parts;
  for (size_t c = 0; c < names.size(); ++c) {
    const ExrChannel& wanted = channel(names[c]);
    if (header(wanted.part).dataWindow() != window)
      throw Error("cannot read '{}': the data windows of '{}' and '{}' differ", path_.string(), first.name,
                  wanted.name);
    planes.try_emplace(&wanted, int(c));
    ++parts[wanted.part];
  }
  return reading([&] {
    Image image(width_of(window), height_of(window), int(names.size()));
    for (const auto& [part, count] : parts) read_part(*file_, planes, part, image);
    for (size_t c = 0; c < names.size(); ++c)
      if (const int from = planes.at(&channel(names[c])); from != int(c))
        std::copy_n(image.plane(from), image.plane_size(), image.plane(int(c)));
    return image;
  });
}

ExrRawChannel ExrFile::read_raw(const std::string& name) {
  const ExrChannel& wanted = channel(name);
  const Imath::Box2i window = header(wanted.part).dataWindow();
  return reading([&] {
    ExrRawChannel raw{wanted.name, wanted.type, wanted.x_sampling, wanted.y_sampling, window, {}};
    raw.bytes.resize(sample_count(wanted, window) * size_bytes_of(wanted.type));
    Imf::FrameBuffer frame;
    frame.insert(wanted.name_in_part, slice(wanted, wanted.type, raw.bytes.data(), window));
    Imf::InputPart input(*file_, wanted.part);
    input.setFrameBuffer(frame);
    input.readPixels(window.min.y, window.max.y);
    return raw;
  });
}

}  // namespace raymeld
