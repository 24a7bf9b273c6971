// Instances, and what a physical device says of itself. Used by device.cpp, and by the library to answer
// before there is a device.
#pragma once

#include <string>
#include <vector>

#include "engine/device.h"

namespace raymeld {

// A Vulkan 1.1 instance.
VkInstance make_instance(VulkanFunctions& vk, Validation validation);

std::vector<VkPhysicalDevice> physical_devices(const VulkanFunctions& vk, VkInstance instance);

DeviceInfo describe(const VulkanFunctions& vk, VkPhysicalDevice physical_device, uint32_t index);

bool has_extension(const VulkanFunctions& vk, VkPhysicalDevice physical_device, const char* name);

// The index into `devices` that `selector` means (see DeviceRequest). Throws Error, listing the devices, when
// it matches none or several.
size_t select_device(const std::vector<DeviceInfo>& devices, const std::string& selector);

}  // namespace raymeld
