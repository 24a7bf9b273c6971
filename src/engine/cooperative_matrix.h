// Finds and enables cooperative matrices (VK_KHR_cooperative_matrix): small matrix products that the lanes of
// a subgroup compute together, with tensor cores where a device has them.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "engine/vulkan.h"

namespace raymeld {

// Describes products (m, k) x (k, n) of 16-bit floats, summed in 32 bits, and the limits of a workgroup that
// computes them.
struct CooperativeMatrix {
  uint32_t m = 0;
  uint32_t n = 0;
  uint32_t k = 0;
  uint32_t subgroup_size = 0;
  bool requires_size = false;  // a pipeline can require subgroup_size; else it is the only size there is
  uint32_t max_invocations = 0;
  uint32_t max_shared_bytes = 0;

  bool operator==(const CooperativeMatrix&) const = default;
};

// Holds the features that a device must enable for cooperative matrices, linked into VkDeviceCreateInfo's
// chain. It cannot be copied: the structures point to each other.
struct CooperativeMatrixFeatures {
  static constexpr std::array<const char*, 4> kExtensions{
      VK_KHR_COOPERATIVE_MATRIX_EXTENSION_NAME, VK_KHR_VULKAN_MEMORY_MODEL_EXTENSION_NAME,
      VK_KHR_SHADER_FLOAT16_INT8_EXTENSION_NAME, VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME};
  VkPhysicalDeviceCooperativeMatrixFeaturesKHR matrix;
  VkPhysicalDeviceVulkanMemoryModelFeatures memory_model;
  VkPhysicalDeviceShaderFloat16Int8Features float16;
  VkPhysicalDeviceSubgroupSizeControlFeaturesEXT subgroups;

  // Chains the structures in front of `next` and turns each feature off or on.
  CooperativeMatrixFeatures(void* next, bool enable);
  CooperativeMatrixFeatures(const CooperativeMatrixFeatures&) = delete;
  CooperativeMatrixFeatures& operator=(const CooperativeMatrixFeatures&) = delete;

  bool all() const;
};

// Returns the shape to compute with, of those that a device lists: 16-bit factors and 32-bit sums, shared by
// a subgroup. 16x16x16 is preferred, then 16x8x16, then the first. Returns null when none is usable.
const VkCooperativeMatrixPropertiesKHR* choose_matrix(
    std::span<const VkCooperativeMatrixPropertiesKHR> listed);

// Returns nothing where the device, or its driver, has no such matrices in compute shaders.
std::optional<CooperativeMatrix> find_cooperative_matrix(const VulkanFunctions& vk,
                                                         VkPhysicalDevice physical_device);

}  // namespace raymeld
