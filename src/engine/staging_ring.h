#pragma once

#include <cstddef>
#include <span>

#include "engine/buffer.h"
#include "engine/frame_ring.h"

namespace raymeld {

// Brings data of the host into buffers that only the device sees. The device copies a piece while the host
// writes the next one. One thread at a time may use it.
class StagingRing {
 public:
  // A piece has at least `piece_bytes`. Throws Error, and OutOfMemory.
  StagingRing(const Device& device, uint64_t piece_bytes);

  uint64_t piece_bytes() const { return piece_bytes_; }
  // Returns the host's memory for the next piece. Waits until the device has copied what it held.
  std::byte* next();
  // Submits the copy of the first bytes of the piece; work that is submitted later reads them. Throws Error.
  void send(const Buffer& to, uint64_t offset_bytes, uint64_t size_bytes);
  // Waits until all pieces are copied. Throws Error.
  void wait() { ring_.wait(); }

 private:
  static constexpr uint32_t kPieces = 3;

  const Device& device_;
  uint64_t piece_bytes_;
  Buffer host_;
  FrameRing ring_;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;  // those of the piece at hand
  uint32_t piece_ = 0;
};

}  // namespace raymeld
