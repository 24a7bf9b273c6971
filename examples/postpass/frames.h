// Frames in flight: each has a slot, whose objects it alone uses until the device is done with it.
#pragma once

#include <optional>
#include <vector>

#include "renderer.h"

namespace postpass {

// What a frame left behind.
struct FrameResult {
  std::array<double, kParts> part_ms{};
  const float* image = nullptr;  // RGBA, sRGB, of the size of Renderer::shown(), if it was captured; until
                                 // the slot is used again
};

class Slot {
 public:
  Slot(const Device& device, const Renderer& renderer, vk::CommandPool pool);

  // Begins the command buffer, for which the slot must be idle.
  vk::CommandBuffer begin();
  // Copies the image that finish() will give; after Renderer::record().
  void record_copy();
  // Ends and submits. `waits_for` and `signals`, of a window's image, may be null.
  void submit(vk::Semaphore waits_for, vk::Semaphore signals);
  // Waits until the device is done with what was submitted; nothing if nothing was.
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

  Slot& next() { return slots_[next_++ % slots_.size()]; }  // the one that has been in flight for longest
  size_t size() const { return slots_.size(); }

 private:
  vk::UniqueCommandPool pool_;
  std::vector<Slot> slots_;
  size_t next_ = 0;
};

}  // namespace postpass
