// Declares the caller's side of Vulkan: handles that raymeld borrows and never owns.
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>

namespace raymeld {

// Describes a Vulkan 1.1 device that the caller made and keeps. All handles must outlive the objects made
// with them.
struct ExternalDevice {
  PFN_vkGetInstanceProcAddr get_instance_proc_addr = nullptr;
  VkInstance instance = VK_NULL_HANDLE;
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;  // must do compute; Devices that wrap the same queue take turns
  uint32_t queue_family = 0;
  bool storage_16bit = false;  // storageBuffer16BitAccess was enabled; needed for fp16
  // Says that bufferDeviceAddress, of VK_KHR_buffer_device_address or Vulkan 1.2, and shaderInt64 were
  // enabled. Some drivers, such as Mesa's for CPUs, are several times faster with them.
  bool buffer_device_address = false;
  // Says that cooperativeMatrix of VK_KHR_cooperative_matrix was enabled, with vulkanMemoryModel,
  // vulkanMemoryModelDeviceScope, shaderFloat16, and subgroupSizeControl and computeFullSubgroups of
  // VK_EXT_subgroup_size_control. Then fp16 convolutions use tensor cores.
  bool cooperative_matrix = false;
  // Says that shaderMixedFloatDotProductFloat16AccFloat32 of VK_VALVE_shader_mixed_float_dot_product was
  // enabled, with shaderFloat16. Then fp16 convolutions do two multiply-adds at once.
  bool half_dots = false;
  // Says that shaderStorageImageWriteWithoutFormat was enabled: output images may then be Vulkan images.
  bool image_writes = false;
  bool float_controls = false;                       // VK_KHR_shader_float_controls was enabled
  bool timeline_semaphore = false;                   // the feature was enabled
  bool external_memory_fd = false;                   // VK_KHR_external_memory_fd was enabled
  const VkAllocationCallbacks* allocator = nullptr;  // used for all that raymeld makes on the device
  VkPipelineCache pipeline_cache = VK_NULL_HANDLE;   // used for all pipelines; null: raymeld keeps its own
};

// Names a part of the caller's memory on the device.
struct MemoryRange {
  VkDeviceMemory memory = VK_NULL_HANDLE;
  VkDeviceSize offset_bytes = 0;
  VkDeviceSize size_bytes = 0;
};

// Describes an image of floats in a storage buffer: element (c, y, x) is at
// offset_bytes / 4 + c * channel_stride + y * row_stride + x * pixel_stride; strides count floats.
struct FrameBuffer {
  VkBuffer buffer = VK_NULL_HANDLE;  // needs VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
  VkDeviceSize offset_bytes = 0;     // a multiple of 4
  uint32_t pixel_stride = 1;
  uint32_t row_stride = 0;
  uint32_t channel_stride = 0;
};

// Describes a Vulkan image by a 2D view of one level and layer. An image that is read needs
// VK_IMAGE_USAGE_SAMPLED_BIT and any format that is sampled as floats; a value is the sampled one * scale +
// bias. An image that is written needs VK_IMAGE_USAGE_STORAGE_BIT; it gets three channels, and 1 in a fourth.
struct FrameTexture {
  VkImageView view = VK_NULL_HANDLE;
  VkImageLayout layout = VK_IMAGE_LAYOUT_GENERAL;  // the image's, during the recording and after it
  uint32_t x = 0, y = 0;                           // the texel that is the first pixel
  float scale = 1, bias = 0;
  bool octahedral = false;  // two channels in [-1, 1] that unfold to a normal
};

}  // namespace raymeld
