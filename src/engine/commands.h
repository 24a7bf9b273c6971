#pragma once

#include "engine/device.h"

namespace raymeld {

// Holds a command pool with command buffers that are recorded once and submitted often.
class Commands {
 public:
  explicit Commands(const Device& device, VkCommandPoolCreateFlags flags = 0);
  ~Commands();
  Commands(const Commands&) = delete;
  Commands& operator=(const Commands&) = delete;

  // Starts a new command buffer, which lives as long as this pool.
  VkCommandBuffer begin(const std::string& name);
  // Starts one of this pool's command buffers anew. It must not be pending, and the pool needs
  // VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT.
  void restart(VkCommandBuffer commands);
  void end(VkCommandBuffer commands);

 private:
  void start(VkCommandBuffer commands);

  const Device& device_;
  VkCommandPool pool_ = VK_NULL_HANDLE;
};

// Records a barrier after which the host may read what shaders wrote, once the commands are done.
void show_host(const Device& device, VkCommandBuffer commands);

// Records a copy between buffers. It waits for the shaders of earlier submits, and later ones and the host
// see its result.
void record_copy(const Device& device, VkCommandBuffer commands, VkBuffer from, VkBuffer to,
                 const VkBufferCopy& region);

// Copies between two buffers, one of which the host fills or reads: submits and waits. Throws Error.
void copy_now(const Device& device, VkBuffer from, VkBuffer to, const VkBufferCopy& region,
              const std::string& name);

// Names the bytes of a buffer that 32 bits are repeated in; both numbers are multiples of 4.
struct FillRegion {
  uint64_t offset_bytes, size_bytes;
  uint32_t pattern;
};

// Records such a fill. It waits for the shaders of earlier work, and later ones see its result.
void record_fill(const Device& device, VkCommandBuffer commands, VkBuffer to, const FillRegion& region);

// Fills a part of a buffer: submits and waits. Throws Error.
void fill_now(const Device& device, VkBuffer to, const FillRegion& region, const std::string& name);

}  // namespace raymeld
