#include "conform/frame_image.h"

#include <algorithm>
#include <vector>

namespace raymeld::conform {

using reference::Planes;

FrameImage::FrameImage(const Device& device, Shape shape, Layout layout) : shape_(shape) {
  const auto [h, w, c] = shape;
  view_.offset_bytes = layout.offset_bytes;
  view_.pixel_stride = layout.interleaved ? c + layout.pixel_padding : 1;
  view_.row_stride = w * view_.pixel_stride + layout.row_padding;
  view_.channel_stride = layout.interleaved ? 1 : h * view_.row_stride + layout.pixel_padding;
  const uint64_t floats =
      layout.interleaved ? uint64_t{h} * view_.row_stride : uint64_t{c} * view_.channel_stride;
  // The host also writes around the image, and Memory::kReadback might need a flush for that.
  buffer_ = Buffer(device, layout.offset_bytes + floats * sizeof(float), Memory::kUpload, "frame image");
  view_.buffer = buffer_.handle();
  std::ranges::fill(values(), kUntouched);
}

FrameImage::FrameImage(const Device& device, const Planes& image, Layout layout)
    : FrameImage(device, Shape{uint32_t(image.h), uint32_t(image.w), uint32_t(image.c)}, layout) {
  write(image);
}

size_t FrameImage::at(uint32_t c, uint32_t y, uint32_t x) const {
  return view_.offset_bytes / 4 + size_t{c} * view_.channel_stride + size_t{y} * view_.row_stride +
         size_t{x} * view_.pixel_stride;
}

std::span<float> FrameImage::values() const {
  return {static_cast<float*>(buffer_.mapped()), buffer_.size_bytes() / sizeof(float)};
}

void FrameImage::write(const Planes& image) {
  for (uint32_t c = 0; c < shape_.channels; ++c) {
    for (uint32_t y = 0; y < shape_.height; ++y) {
      for (uint32_t x = 0; x < shape_.width; ++x) {
        values()[at(c, y, x)] = float(image.at(int(c), int(y), int(x)));
      }
    }
  }
}

Planes FrameImage::read() const {
  Planes image(int(shape_.channels), int(shape_.height), int(shape_.width));
  for (uint32_t c = 0; c < shape_.channels; ++c) {
    for (uint32_t y = 0; y < shape_.height; ++y) {
      for (uint32_t x = 0; x < shape_.width; ++x) {
        image.at(int(c), int(y), int(x)) = values()[at(c, y, x)];
      }
    }
  }
  return image;
}

size_t FrameImage::touched_outside() const {
  std::vector<float> rest(values().begin(), values().end());
  for (uint32_t c = 0; c < shape_.channels; ++c) {
    for (uint32_t y = 0; y < shape_.height; ++y) {
      for (uint32_t x = 0; x < shape_.width; ++x) rest[at(c, y, x)] = kUntouched;
    }
  }
  return rest.size() - size_t(std::ranges::count(rest, kUntouched));
}

std::span<const FrameImage::Layout> frame_layouts() {
  static const FrameImage::Layout layouts[] = {
      {},
      {.interleaved = true},
      {.offset_bytes = 20, .interleaved = true, .pixel_padding = 1},
      {.offset_bytes = 4096 + 4, .pixel_padding = 3, .row_padding = 5},
      {.offset_bytes = 12, .interleaved = true, .pixel_padding = 2, .row_padding = 7},
  };
  return layouts;
}

}  // namespace raymeld::conform
