#include "engine/cooperative_matrix.h"

#include <algorithm>
#include <vector>

#include "engine/instance.h"

namespace raymeld {

CooperativeMatrixFeatures::CooperativeMatrixFeatures(void* next, bool enable)
    : matrix(vk_struct<VkPhysicalDeviceCooperativeMatrixFeaturesKHR>(
          VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_KHR, &memory_model)),
      memory_model(vk_struct<VkPhysicalDeviceVulkanMemoryModelFeatures>(
          VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_MEMORY_MODEL_FEATURES, &float16)),
      float16(vk_struct<VkPhysicalDeviceShaderFloat16Int8Features>(
          VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_FLOAT16_INT8_FEATURES, &subgroups)),
      subgroups(vk_struct<VkPhysicalDeviceSubgroupSizeControlFeaturesEXT>(
          VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES_EXT, next)) {
  matrix.cooperativeMatrix = memory_model.vulkanMemoryModel = enable;
  memory_model.vulkanMemoryModelDeviceScope = enable;  // the atomics' scope under the memory model
  float16.shaderFloat16 = subgroups.subgroupSizeControl = subgroups.computeFullSubgroups = enable;
}

bool CooperativeMatrixFeatures::all() const {
  return matrix.cooperativeMatrix && memory_model.vulkanMemoryModel &&
         memory_model.vulkanMemoryModelDeviceScope && float16.shaderFloat16 &&
         subgroups.subgroupSizeControl && subgroups.computeFullSubgroups;
}

const VkCooperativeMatrixPropertiesKHR* choose_matrix(
    std::span<const VkCooperativeMatrixPropertiesKHR> listed) {
  const auto rank = [](const VkCooperativeMatrixPropertiesKHR& p) {
    const bool usable = p.AType == VK_COMPONENT_TYPE_FLOAT16_KHR &&
                        p.BType == VK_COMPONENT_TYPE_FLOAT16_KHR &&
                        p.CType == VK_COMPONENT_TYPE_FLOAT32_KHR &&
                        p.ResultType == VK_COMPONENT_TYPE_FLOAT32_KHR && p.scope == VK_SCOPE_SUBGROUP_KHR;
    const bool wide = p.MSize == 16 && p.KSize == 16;
    return !usable ? 0 : wide && p.NSize == 16 ? 3 : wide && p.NSize == 8 ? 2 : 1;
  };
  const auto best =
      std::ranges::max_element(listed, [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
  return best != listed.end() && rank(*best) > 0 ? &*best : nullptr;
}

std::optional<CooperativeMatrix> find_cooperative_matrix(const VulkanFunctions& vk, VkPhysicalDevice device) {
  const auto& names = CooperativeMatrixFeatures::kExtensions;
  if (!vk.GetPhysicalDeviceCooperativeMatrixPropertiesKHR ||
      !std::ranges::all_of(names, [&](const char* name) { return has_extension(vk, device, name); })) {
    return {};
  }
  CooperativeMatrixFeatures has(nullptr, false);
  auto features =
      vk_struct<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &has.matrix);
  vk.GetPhysicalDeviceFeatures2(device, &features);
  auto stages = vk_struct<VkPhysicalDeviceCooperativeMatrixPropertiesKHR>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_PROPERTIES_KHR);
  auto subgroup = vk_struct<VkPhysicalDeviceSubgroupProperties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES, &stages);
  auto sizes = vk_struct<VkPhysicalDeviceSubgroupSizeControlPropertiesEXT>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_PROPERTIES_EXT, &subgroup);
  auto all = vk_struct<VkPhysicalDeviceProperties2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, &sizes);
  vk.GetPhysicalDeviceProperties2(device, &all);
  const bool requires_size = sizes.requiredSubgroupSizeStages & VK_SHADER_STAGE_COMPUTE_BIT;
  const bool one_size = sizes.minSubgroupSize == sizes.maxSubgroupSize;
  if (!has.all() || !(requires_size || one_size) ||
      !(stages.cooperativeMatrixSupportedStages & VK_SHADER_STAGE_COMPUTE_BIT)) {
    return {};
  }
  uint32_t count = 0;
  check(vk.GetPhysicalDeviceCooperativeMatrixPropertiesKHR(device, &count, nullptr),
        "listing cooperative matrices");
  std::vector<VkCooperativeMatrixPropertiesKHR> listed(
      count,
      vk_struct<VkCooperativeMatrixPropertiesKHR>(VK_STRUCTURE_TYPE_COOPERATIVE_MATRIX_PROPERTIES_KHR));
  check(vk.GetPhysicalDeviceCooperativeMatrixPropertiesKHR(device, &count, listed.data()),
        "listing cooperative matrices");
  const VkCooperativeMatrixPropertiesKHR* shape = choose_matrix(listed);
  if (!shape) return {};
  const VkPhysicalDeviceLimits& limits = all.properties.limits;
  uint32_t max_invocations =
      std::min(limits.maxComputeWorkGroupInvocations, limits.maxComputeWorkGroupSize[0]);
  if (requires_size)
    max_invocations = std::min(max_invocations, subgroup.subgroupSize * sizes.maxComputeWorkgroupSubgroups);
  return CooperativeMatrix{.m = shape->MSize,
                           .n = shape->NSize,
                           .k = shape->KSize,
                           .subgroup_size = subgroup.subgroupSize,
                           .requires_size = requires_size,
                           .max_invocations = max_invocations,
                           .max_shared_bytes = limits.maxComputeSharedMemorySize};
}

}  // namespace raymeld
