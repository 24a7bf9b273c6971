// Makes instances and describes physical devices. Device uses it, and so does the library to answer before
// there is a device.
#pragma once

#include <string>
#include <vector>

#include "engine/device.h"

namespace raymeld {

// Makes a Vulkan 1.1 instance and loads its functions into `vk`.
VkInstance make_instance(VulkanFunctions& vk, Validation validation);

std::vector<VkPhysicalDevice> physical_devices(const VulkanFunctions& vk, VkInstance instance);

DeviceInfo device_info(const VulkanFunctions& vk, VkPhysicalDevice physical_device, uint32_t index);

bool has_extension(const VulkanFunctions& vk, VkPhysicalDevice physical_device, const char* name);

// Returns the index of the device that `selector` means (see DeviceRequest). Throws Error, which lists the
// devices, when none or several match.
size_t select_device(const std::vector<DeviceInfo>& devices, const std::string& selector);

}  // namespace raymeld
