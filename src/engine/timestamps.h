#pragma once

#include <optional>
#include <vector>

#include "engine/device.h"

namespace raymeld {

// Holds timestamps that a command buffer writes, one before its first pass and one after each pass. A pass
// may stand for several.
class Timestamps {
 public:
  // The device must have timestamps. Throws Error.
  Timestamps(const Device& device, uint32_t passes);
  ~Timestamps();
  Timestamps(const Timestamps&) = delete;
  Timestamps& operator=(const Timestamps&) = delete;

  // Records the timestamp before the first pass, which must come before all others.
  void start(VkCommandBuffer commands) const;
  // Records the timestamp after pass `index`.
  void mark(VkCommandBuffer commands, uint32_t index) const;
  // Returns the milliseconds of each pass, or nothing where a driver that computes nothing has written none.
  // The commands must be done. Throws Error.
  std::optional<std::vector<double>> pass_ms() const;

 private:
  const Device& device_;
  uint32_t passes_;
  VkQueryPool pool_ = VK_NULL_HANDLE;
};

}  // namespace raymeld
