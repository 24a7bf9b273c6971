#pragma once

#include <map>
#include <string>
#include <vector>

#include "engine/device.h"

namespace raymeld::test {

// A Vulkan device as a program that embeds raymeld would make it, with validation. Every call that raymeld
// makes through external().get_instance_proc_addr to a function that may fail is counted by the function's
// name, and may be made to fail: see faults.h. A new device forgets the counts and faults of the one before.
class CallerDevice {
 public:
  // `addresses`, `matrices`: enables buffer addresses and cooperative matrices, where the device has them.
  explicit CallerDevice(bool storage_16bit = true, bool addresses = true, bool matrices = true);
  ~CallerDevice();  // fails the test on any validation message, of objects left behind too
  CallerDevice(const CallerDevice&) = delete;
  CallerDevice& operator=(const CallerDevice&) = delete;

  const ExternalDevice& external() const { return external_; }
  const VulkanFunctions& vk() const { return vk_; }

  // Calls since the last time this was asked.
  std::map<std::string, int> take_calls();

 private:
  VulkanFunctions vk_;
  ExternalDevice external_;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  std::vector<std::string> messages_;
};

}  // namespace raymeld::test
