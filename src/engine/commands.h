#pragma once

#include "engine/device.h"

namespace raymeld {

// A command pool with command buffers that are recorded once and submitted often.
class Commands {
 public:
  explicit Commands(const Device& device);
  ~Commands();
  Commands(const Commands&) = delete;
  Commands& operator=(const Commands&) = delete;

  // Starts a new command buffer, which lives as long as this pool.
  VkCommandBuffer begin(const std::string& name);
  void end(VkCommandBuffer commands);

 private:
  const Device& device_;
  VkCommandPool pool_ = VK_NULL_HANDLE;
};

// A copy between two buffers of which the host fills or reads one: submits and waits. Throws Error.
void copy_now(const Device& device, VkBuffer from, VkBuffer to, const VkBufferCopy& region,
              const std::string& name);

}  // namespace raymeld
