// Keeps frames in flight. Each has a slot, whose objects are its own until the device is done with the frame.
#pragma once

#include <optional>
#include <vector>

#include "renderer.h"

namespace postpass {

// Holds the times of a finished frame, and its image.
struct FrameResult {
  std::array<double, kParts> part_ms{};
  // Points to RGBA in sRGB, of the size of Renderer::shown(), until the slot is used again. Null if the image
  // was not captured.
  const float* image = nullptr;
};

class Slot {
 public:
  Slot(const Device& device, const Renderer& renderer, vk::CommandPool pool);

  // Begins the command buffer, for which the slot must be idle.
  vk::CommandBuffer begin();
  // Records a copy of the image for finish() to return. Call it after Renderer::record().
  void record_copy();
  // Ends and submits the command buffer. `waits_for` and `signals` are those of a window's image, or null.
  void submit(vk::Semaphore waits_for, vk::Semaphore signals);
  // Waits until the device is done with the submission and returns its result, or nothing if there was none.
  std::optional<FrameResult> finish();

  vk::QueryPool queries() const { return *queries_; }
  vk::Semaphore acquired() const { return *acquired_; }

 private:
  const Device& device_;
  const Renderer& renderer_;
  vk::UniqueCommandBuffer commands_;
  vk::UniqueFence done_;
  vk::UniqueQueryPool queries_;
  vk::UniqueSemaphore acquired_;
  Buffer image_;
  bool pending_ = false, captured_ = false;
};

class Frames {
 public:
  Frames(const Device& device, const Renderer& renderer, uint32_t in_flight);

  Slot& next() { return slots_[next_++ % slots_.size()]; }  // the slot that has been in flight for longest
  size_t size() const { return slots_.size(); }

 private:
  vk::UniqueCommandPool pool_;
  std::vector<Slot> slots_;
  size_t next_ = 0;
};

}  // namespace postpass
