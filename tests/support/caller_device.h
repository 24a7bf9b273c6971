#pragma once

#include <map>
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

}  // namespace raymeld::test
