#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "engine/device.h"

namespace raymeld::test {

// Makes a Vulkan device as a program that embeds raymeld would, with asked_validation(). Calls that raymeld
// makes through external().get_instance_proc_addr to functions that may fail are counted by the function's
// name, and may be made to fail: see faults.h. A new device forgets the counts and faults of the one before.
class CallerDevice {
 public:
  // `addresses` and `matrices` enable buffer addresses and cooperative matrices where the device has them.
  explicit CallerDevice(bool storage_16bit = true, bool addresses = true, bool matrices = true);
  ~CallerDevice();  // fails the test on any validation message, also on one about objects left alive
  CallerDevice(const CallerDevice&) = delete;
  CallerDevice& operator=(const CallerDevice&) = delete;

  const ExternalDevice& external() const { return external_; }
  const VulkanFunctions& vk() const { return vk_; }

  // Returns the calls since the last time this was asked.
  std::map<std::string, int> take_calls();

 private:
  VulkanFunctions vk_;
  ExternalDevice external_;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  std::vector<std::string> messages_;
};

// Holds memory of the caller's device that the host sees, every byte of which is 0xff at first.
class CallerMemory {
 public:
  // Takes one of the memory types in `type_bits`; is_null() if the host sees none of them.
  CallerMemory(const CallerDevice& device, VkDeviceSize size_bytes, uint32_t type_bits, bool device_address);
  ~CallerMemory();
  CallerMemory(const CallerMemory&) = delete;
  CallerMemory& operator=(const CallerMemory&) = delete;

  bool is_null() const { return !memory_; }
  VkDeviceMemory handle() const { return memory_; }
  std::span<uint8_t> bytes() const { return bytes_; }
  // Returns whether bytes [begin, end) are as at first.
  bool is_untouched(VkDeviceSize begin, VkDeviceSize end) const;

 private:
  const CallerDevice& device_;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  std::span<uint8_t> bytes_;
};

}  // namespace raymeld::test
