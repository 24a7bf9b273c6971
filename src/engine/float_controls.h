// Asks a driver how to make values of 16 bits (VK_KHR_shader_float_controls). Without this Vulkan lets a
// driver truncate them, and flush subnormal ones to zero. That NaN and infinity are kept in 32 bits is not
// asked for: it took a twelfth more of a filter's cycles on GPUs, and shaders find such values by their bits
// (finite.glsl).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/vulkan.h"

namespace raymeld {

// Says what a driver promises when a shader asks for it.
struct FloatControls {
  bool rounds = false;            // rounds to the nearest value of 16 bits, to the even one of two
  bool keeps_subnormals = false;  // keeps subnormal values of 16 bits

  bool any() const { return rounds || keeps_subnormals; }
};

// Returns nothing but false where the device lacks the extension.
FloatControls find_float_controls(const VulkanFunctions& vk, VkPhysicalDevice physical_device);

// Returns a shader that asks for what `promised` has, if it has values of 16 bits.
std::vector<uint32_t> with_float_controls(std::span<const uint32_t> spirv, const FloatControls& promised);

}  // namespace raymeld
