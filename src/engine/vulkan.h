// Declares the Vulkan functions that raymeld calls. They are fetched through the caller's
// vkGetInstanceProcAddr or the loader's, a library opened at run time, so that a machine without Vulkan gets
// a message instead of a link error.
#pragma once

#include <vulkan/vulkan_core.h>

#include <string>

#include "engine/khr_cooperative_matrix.h"
#include "error.h"

#define RAYMELD_GLOBAL_FUNCTIONS(X)   \
  X(CreateInstance)                   \
  X(EnumerateInstanceVersion)         \
  X(EnumerateInstanceLayerProperties) \
  X(EnumerateInstanceExtensionProperties)

#define RAYMELD_INSTANCE_FUNCTIONS(X)          \
  X(DestroyInstance)                           \
  X(EnumeratePhysicalDevices)                  \
  X(GetPhysicalDeviceProperties)               \
  X(GetPhysicalDeviceProperties2)              \
  X(GetPhysicalDeviceFeatures2)                \
  X(GetPhysicalDeviceMemoryProperties)         \
  X(GetPhysicalDeviceMemoryProperties2)        \
  X(GetPhysicalDeviceQueueFamilyProperties)    \
  X(GetPhysicalDeviceExternalBufferProperties) \
  X(EnumerateDeviceExtensionProperties)        \
  X(GetDeviceProcAddr)                         \
  X(CreateDevice)

#define RAYMELD_DEVICE_FUNCTIONS(X) \
  X(DestroyDevice)                  \
  X(GetDeviceQueue)                 \
  X(QueueSubmit)                    \
  X(QueueWaitIdle)                  \
  X(DeviceWaitIdle)                 \
  X(CreateBuffer)                   \
  X(DestroyBuffer)                  \
  X(GetBufferMemoryRequirements)    \
  X(AllocateMemory)                 \
  X(FreeMemory)                     \
  X(BindBufferMemory)               \
  X(MapMemory)                      \
  X(FlushMappedMemoryRanges)        \
  X(InvalidateMappedMemoryRanges)   \
  X(CreateShaderModule)             \
  X(DestroyShaderModule)            \
  X(CreateDescriptorSetLayout)      \
  X(DestroyDescriptorSetLayout)     \
  X(CreatePipelineLayout)           \
  X(DestroyPipelineLayout)          \
  X(CreateComputePipelines)         \
  X(DestroyPipeline)                \
  X(CreatePipelineCache)            \
  X(DestroyPipelineCache)           \
  X(GetPipelineCacheData)           \
  X(CreateDescriptorPool)           \
  X(DestroyDescriptorPool)          \
  X(AllocateDescriptorSets)         \
  X(UpdateDescriptorSets)           \
  X(CreateCommandPool)              \
  X(DestroyCommandPool)             \
  X(AllocateCommandBuffers)         \
  X(BeginCommandBuffer)             \
  X(ResetCommandBuffer)             \
  X(EndCommandBuffer)               \
  X(CreateFence)                    \
  X(DestroyFence)                   \
  X(ResetFences)                    \
  X(GetFenceStatus)                 \
  X(WaitForFences)                  \
  X(CreateQueryPool)                \
  X(DestroyQueryPool)               \
  X(GetQueryPoolResults)            \
  X(CmdBindPipeline)                \
  X(CmdBindDescriptorSets)          \
  X(CmdPushConstants)               \
  X(CmdDispatch)                    \
  X(CmdDispatchBase)                \
  X(CmdPipelineBarrier)             \
  X(CmdCopyBuffer)                  \
  X(CmdFillBuffer)                  \
  X(CmdResetQueryPool)              \
  X(CmdWriteTimestamp)

namespace raymeld {

// Vulkan's headers count the extension as provisional and leave its name out.
inline constexpr const char* kPortabilitySubset = "VK_KHR_portability_subset";

struct VulkanFunctions {
  PFN_vkGetInstanceProcAddr GetInstanceProcAddr = nullptr;
#define RAYMELD_DECLARE(name) PFN_vk##name name = nullptr;
  RAYMELD_GLOBAL_FUNCTIONS(RAYMELD_DECLARE)
  RAYMELD_INSTANCE_FUNCTIONS(RAYMELD_DECLARE)
  RAYMELD_DEVICE_FUNCTIONS(RAYMELD_DECLARE)
#undef RAYMELD_DECLARE
  // These are null unless the instance has VK_EXT_debug_utils.
  PFN_vkCreateDebugUtilsMessengerEXT CreateDebugUtilsMessengerEXT = nullptr;
  PFN_vkDestroyDebugUtilsMessengerEXT DestroyDebugUtilsMessengerEXT = nullptr;
  PFN_vkSetDebugUtilsObjectNameEXT SetDebugUtilsObjectNameEXT = nullptr;
  // This is null unless a driver knows VK_KHR_cooperative_matrix.
  PFN_vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR GetPhysicalDeviceCooperativeMatrixPropertiesKHR =
      nullptr;
  // This is null unless the device has buffer_device_address.
  PFN_vkGetBufferDeviceAddress GetBufferDeviceAddress = nullptr;
  // These are null unless the device has VK_KHR_pipeline_executable_properties.
  PFN_vkGetPipelineExecutablePropertiesKHR GetPipelineExecutablePropertiesKHR = nullptr;
  PFN_vkGetPipelineExecutableStatisticsKHR GetPipelineExecutableStatisticsKHR = nullptr;
  // This is null unless the device has VK_KHR_external_memory_fd.
  PFN_vkGetMemoryFdPropertiesKHR GetMemoryFdPropertiesKHR = nullptr;

  // Opens the system's loader once per process. Throws Error when there is none.
  static VulkanFunctions load();

  void load_instance(VkInstance instance);
  void load_device(VkDevice device);
};

// Returns a Vulkan structure with its type and chain set and all else zero.
template <typename Structure>
Structure vk_struct(VkStructureType type, decltype(Structure::pNext) next = nullptr) {
  Structure structure{};
  structure.sType = type;
  structure.pNext = next;
  return structure;
}

// Returns the name of a result code, such as "VK_ERROR_DEVICE_LOST".
std::string result_name(VkResult result);

// Is thrown when a device does not have the memory that was asked of it; less may do.
class OutOfMemory : public Error {
 public:
  using Error::Error;
};

// Is thrown when the host does not have the memory, which smaller buffers would not help.
class OutOfHostMemory : public Error {
 public:
  using Error::Error;
};

// Is thrown when the driver gave up the device. No object made on it works any more, but a new Device may.
class DeviceLost : public Error {
 public:
  using Error::Error;
};

// Throws Error "WHAT: VK_ERROR_..." unless the call succeeded: OutOfMemory for VK_ERROR_OUT_OF_DEVICE_MEMORY,
// OutOfHostMemory for VK_ERROR_OUT_OF_HOST_MEMORY, DeviceLost for VK_ERROR_DEVICE_LOST.
void check(VkResult result, const std::string& what);

}  // namespace raymeld
