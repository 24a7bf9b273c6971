// Enables dot products of two pairs of 16-bit floats that are added to a sum of 32 bits
// (VK_VALVE_shader_mixed_float_dot_product). With these a GPU does twice as many multiply-adds as in 32 bits.
#pragma once

#include <array>
#include <span>

#include "engine/valve_half_dots.h"
#include "engine/vulkan.h"

namespace raymeld {

// Holds the features that a device must enable for these dot products, linked into VkDeviceCreateInfo's
// chain. It cannot be copied: one structure points to the other.
struct HalfDotFeatures {
  // Cooperative matrices need the second one too.
  static constexpr std::array<const char*, 2> kExtensions{
      VK_VALVE_SHADER_MIXED_FLOAT_DOT_PRODUCT_EXTENSION_NAME, VK_KHR_SHADER_FLOAT16_INT8_EXTENSION_NAME};
  VkPhysicalDeviceShaderMixedFloatDotProductFeaturesVALVE dots;
  VkPhysicalDeviceShaderFloat16Int8Features float16;

  // Chains the structures in front of `next` and turns both features off or on. Where cooperative matrices
  // are enabled, the chain has the second one already.
  HalfDotFeatures(void* next, bool enable, bool with_matrices)
      : dots(vk_struct<VkPhysicalDeviceShaderMixedFloatDotProductFeaturesVALVE>(
            VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_MIXED_FLOAT_DOT_PRODUCT_FEATURES_VALVE,
            with_matrices ? next : &float16)),
        float16(vk_struct<VkPhysicalDeviceShaderFloat16Int8Features>(
            VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_FLOAT16_INT8_FEATURES, next)) {
    dots.shaderMixedFloatDotProductFloat16AccFloat32 = float16.shaderFloat16 = enable;
  }
  HalfDotFeatures(const HalfDotFeatures&) = delete;
  HalfDotFeatures& operator=(const HalfDotFeatures&) = delete;

  // Returns the extensions that the device must enable beyond those of what follows in the chain.
  std::span<const char* const> extensions() const {
    return std::span(kExtensions).first(dots.pNext == &float16 ? 2 : 1);
  }
};

}  // namespace raymeld
