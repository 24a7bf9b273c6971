#pragma once

#include <cstdint>

#include "error.h"

namespace raymeld {

// Says how activations and weights are stored in device memory; sums are always 32-bit.
enum class Storage { kFloat32, kFloat16 };

constexpr uint64_t element_bytes(Storage storage) { return storage == Storage::kFloat16 ? 2 : 4; }

struct Shape {
  uint32_t height = 0;
  uint32_t width = 0;
  uint32_t channels = 0;

  bool operator==(const Shape&) const = default;
  uint64_t pixels() const { return uint64_t{height} * width; }
};

// Returns the number of elements from one channel's plane to the next. Planes start at multiples of 256
// bytes, the largest alignment that Vulkan lets a device ask of a binding's offset, so that any run of
// channels can be bound by itself. They are never whole pages apart: the same pixel of all channels would
// then compete for one place of a cache.
constexpr uint64_t plane_stride(uint64_t pixels, Storage storage) {
  constexpr uint64_t kStepBytes = 256, kPageBytes = 4096;
  const uint64_t bytes = (pixels * element_bytes(storage) + kStepBytes - 1) / kStepBytes * kStepBytes;
  return (bytes % kPageBytes == 0 ? bytes + kStepBytes : bytes) / element_bytes(storage);
}

// Names a run of channels of a graph's activation; it owns nothing. Activations are planar: element (c, y, x)
// is at (channel_offset + c) * plane_stride + y * width + x. Slices of a wide tensor serve as concatenation.
struct Tensor {
  uint32_t id = 0;
  Shape shape;
  uint32_t channel_offset = 0;

  bool operator==(const Tensor&) const = default;
  // Returns channels [first, first + count) of this tensor, without a copy.
  Tensor slice(uint32_t first, uint32_t count) const {
    if (first + count > shape.channels) {
      throw Error("slice [{}, {}) of a tensor of {} channels", first, first + count, shape.channels);
    }
    return {id, {shape.height, shape.width, count}, channel_offset + first};
  }
};

}  // namespace raymeld
