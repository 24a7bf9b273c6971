// The caller's side of Vulkan: handles that raymeld borrows, never owns.
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>

namespace raymeld {

// A Vulkan 1.1 device that the caller made and keeps: all handles must outlive what is made with them.
struct ExternalDevice {
  PFN_vkGetInstanceProcAddr get_instance_proc_addr = nullptr;
  VkInstance instance = VK_NULL_HANDLE;
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;  // must do compute; Devices that wrap the same take turns
  uint32_t queue_family = 0;
  bool storage_16bit = false;  // whether storageBuffer16BitAccess was enabled; needed for fp16
  // Whether bufferDeviceAddress, of VK_KHR_buffer_device_address or Vulkan 1.2, and shaderInt64 were enabled:
  // some drivers, Mesa's for CPUs among them, are several times faster with them.
  bool buffer_device_address = false;
  // Whether cooperativeMatrix of VK_KHR_cooperative_matrix was enabled, with vulkanMemoryModel,
  // vulkanMemoryModelDeviceScope, shaderFloat16, and computeFullSubgroups of VK_EXT_subgroup_size_control:
  // fp16 convolutions can then use tensor cores, where `raymeld tune` found that to be fastest.
  bool cooperative_matrix = false;
  // Whether shaderStorageImageWriteWithoutFormat was enabled: fused images may then be images of Vulkan.
  bool image_writes = false;
  bool timeline_semaphore = false;                   // whether it was enabled
  bool external_memory_fd = false;                   // whether VK_KHR_external_memory_fd was enabled
  const VkAllocationCallbacks* allocator = nullptr;  // of all that raymeld makes on the device
  VkPipelineCache pipeline_cache = VK_NULL_HANDLE;   // for all pipelines; null: raymeld keeps its own
};

// A part of the caller's memory on the device.
struct MemoryRange {
  VkDeviceMemory memory = VK_NULL_HANDLE;
  VkDeviceSize offset_bytes = 0;
  VkDeviceSize size_bytes = 0;
};

// An image of floats in a storage buffer: element (c, y, x) is at
// offset_bytes / 4 + c * channel_stride + y * row_stride + x * pixel_stride; strides count floats.
struct FrameBuffer {
  VkBuffer buffer = VK_NULL_HANDLE;  // with VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
  VkDeviceSize offset_bytes = 0;     // a multiple of 4
  uint32_t pixel_stride = 1;
  uint32_t row_stride = 0;
  uint32_t channel_stride = 0;
};

// An image of Vulkan: a 2D view of one level and layer. Read: with VK_IMAGE_USAGE_SAMPLED_BIT, any format
// that is sampled as floats, each value being value * scale + bias of what it holds. Written: with
// VK_IMAGE_USAGE_STORAGE_BIT, three channels, and 1 in a fourth.
struct FrameTexture {
  VkImageView view = VK_NULL_HANDLE;
  VkImageLayout layout = VK_IMAGE_LAYOUT_GENERAL;  // while the recording runs, and after it
  uint32_t x = 0, y = 0;                           // the texel that is the first pixel
  float scale = 1, bias = 0;
  bool octahedral = false;  // two channels in [-1, 1], of which a normal is made
};

}  // namespace raymeld
