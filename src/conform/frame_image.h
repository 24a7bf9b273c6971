#pragma once

#include <cstddef>
#include <span>

#include "engine/program.h"
#include "reference/reference.h"

namespace raymeld::conform {

// Holds an image of floats in a buffer, laid out as a caller might do it, in memory that host and device both
// see. Everything outside the image holds kUntouched.
class FrameImage {
 public:
  static constexpr float kUntouched = -12345.0f;

  struct Layout {
    uint64_t offset_bytes = 0;
    bool interleaved = false;
    uint32_t pixel_padding = 0;  // floats after each pixel (interleaved) or each plane
    uint32_t row_padding = 0;    // floats after each row
  };

  // These make an image of kUntouched; without a layout it is planar and dense.
  FrameImage(const Device& device, Shape shape) : FrameImage(device, shape, Layout{}) {}
  FrameImage(const Device& device, Shape shape, Layout layout);
  // These make a copy of `image`.
  FrameImage(const Device& device, const reference::Planes& image) : FrameImage(device, image, Layout{}) {}
  FrameImage(const Device& device, const reference::Planes& image, Layout layout);

  FrameBinding binding() const { return {.view = view_, .shape = shape_, .address = buffer_.address()}; }
  // Returns a frame that has no other image.
  FrameBindings frame(FrameSlot slot) const {
    FrameBindings frame;
    frame[slot] = binding();
    return frame;
  }
  const FrameBuffer& view() const { return view_; }
  reference::Planes read() const;
  // Returns how many floats around the image no longer hold kUntouched.
  size_t touched_outside() const;

 private:
  void write(const reference::Planes& image);
  size_t at(uint32_t c, uint32_t y, uint32_t x) const;
  std::span<float> values() const;

  Shape shape_;
  FrameBuffer view_;
  Buffer buffer_;
};

// Returns the layouts that encode reads and decode writes in the suites: dense, interleaved, padded, at an
// offset that is no multiple of the storage alignment.
std::span<const FrameImage::Layout> frame_layouts();

}  // namespace raymeld::conform
