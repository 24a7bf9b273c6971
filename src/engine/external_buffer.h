// Imports a buffer in memory that another device, API or process exported as a file descriptor.
#pragma once

#include "engine/device.h"

namespace raymeld {

// Describes exported memory, and where the buffer lies in it.
struct MemoryFd {
  int fd = -1;
  VkExternalMemoryHandleTypeFlagBits type = VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT;
  uint64_t memory_size_bytes = 0;
  uint32_t memory_type = 0;  // read for an opaque descriptor
  bool dedicated = false;    // allocated for one buffer
  uint64_t offset_bytes = 0, size_bytes = 0;
};

class ExternalBuffer {
 public:
  // Imports the memory. The caller keeps `from.fd` and may close it. Throws Error where the device cannot
  // import such memory, or a buffer cannot lie there.
  ExternalBuffer(const Device& device, const MemoryFd& from);
  ~ExternalBuffer() { destroy(); }
  ExternalBuffer(const ExternalBuffer&) = delete;
  ExternalBuffer& operator=(const ExternalBuffer&) = delete;

  VkBuffer handle() const { return buffer_; }

 private:
  void create(const MemoryFd& from);
  void import(const MemoryFd& from, const VkMemoryRequirements& needs);
  void destroy();

  const Device& device_;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
};

}  // namespace raymeld
