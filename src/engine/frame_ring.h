// Keeps the frames that raymeld submits itself.
#pragma once

#include <span>
#include <vector>

#include "engine/commands.h"

namespace raymeld {

struct SemaphoreValue {
  VkSemaphore semaphore = VK_NULL_HANDLE;
  uint64_t value = 0;  // the value of a timeline semaphore; 0: a binary one
};

// Holds command buffers that take turns, each with a fence. One thread at a time may use it.
class FrameRing {
 public:
  FrameRing(const Device& device, uint32_t frames);
  ~FrameRing();  // waits as wait() does

  // Starts command buffer `frame` anew, after waiting for its last submit. Throws Error.
  VkCommandBuffer begin(uint32_t frame);
  // Ends and submits command buffer `frame`, all of whose commands wait. Threads take turns, as in
  // Device::submit(). Throws Error.
  void submit(uint32_t frame, std::span<const SemaphoreValue> wait, std::span<const SemaphoreValue> signal);
  // Returns whether the device has not done the last submit of command buffer `frame`.
  bool is_pending(uint32_t frame) const;
  // Waits for all that was submitted. Throws Error.
  void wait();

 private:
  struct Frame {
    VkCommandBuffer commands = VK_NULL_HANDLE;
    VkFence fence = VK_NULL_HANDLE;
    bool is_pending = false;
  };
  void wait_for(Frame& frame);
  void destroy_fences();

  const Device& device_;
  Commands pool_;
  std::vector<Frame> frames_;
};

}  // namespace raymeld
