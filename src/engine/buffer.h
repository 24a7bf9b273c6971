#pragma once

#include <optional>
#include <string>

#include "engine/device.h"

namespace raymeld {

enum class Memory {
  kDevice,    // fastest for the device; the host may not see it
  kUpload,    // the host writes, the device reads
  kReadback,  // the device writes, the host reads
  kShared,    // both read and write a few bytes, the device more often
};

// Returns the index of the best memory type for this among the `allowed` bits, or nothing.
std::optional<uint32_t> memory_type(const VkPhysicalDeviceMemoryProperties& types, uint32_t allowed,
                                    Memory memory);

// Holds a storage buffer, in memory of its own or in the caller's. It can be moved, but not copied.
class Buffer {
 public:
  Buffer() = default;
  // Allocates the memory. Throws Error, which names the buffer and its size, and OutOfMemory when the device
  // has no such memory left.
  Buffer(const Device& device, uint64_t size_bytes, Memory memory, const std::string& name);
  // Places the buffer in the caller's memory, which requirements() must allow; never maps it. Throws Error.
  Buffer(const Device& device, uint64_t size_bytes, const MemoryRange& memory, const std::string& name);
  ~Buffer();
  Buffer(Buffer&& other) noexcept { *this = std::move(other); }
  Buffer& operator=(Buffer&& other) noexcept;

  // Returns what memory such a buffer needs. Throws Error.
  static VkMemoryRequirements requirements(const Device& device, uint64_t size_bytes);

  VkBuffer handle() const { return buffer_; }
  uint64_t size_bytes() const { return size_bytes_; }
  uint64_t allocated_bytes() const { return memory_ ? size_bytes_ : 0; }
  // Returns the address on the device, or 0 where DeviceInfo::buffer_device_address is false.
  VkDeviceAddress address() const { return address_; }
  // Returns the host's view for the buffer's whole life, or null when the host does not see the memory.
  void* mapped() const { return mapped_; }
  // Makes the host's writes to mapped() visible to work that is submitted from then on; needed for kDevice.
  void flush() const;
  // Makes the device's writes visible to the host; needed before reading mapped() of a kReadback buffer.
  void invalidate() const;

 private:
  VkMemoryRequirements create(const Device& device, const std::string& name, const std::string& what);
  void bind(VkDeviceMemory memory, uint64_t offset_bytes, const std::string& what);
  VkMappedMemoryRange whole() const;

  const Device* device_ = nullptr;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;  // null in the caller's memory
  void* mapped_ = nullptr;
  VkDeviceAddress address_ = 0;
  uint64_t size_bytes_ = 0;
  bool coherent_ = true;
};

}  // namespace raymeld
