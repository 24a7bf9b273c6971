// Buffers and images with memory of their own.
#pragma once

#include <vulkan/vulkan.hpp>

#include "device.h"

namespace postpass {

struct Buffer {
  vk::UniqueDeviceMemory memory;
  vk::UniqueBuffer buffer;
  const float* mapped = nullptr;  // of readback_buffer()
};

// On the device; storage, and both ends of copies.
Buffer make_buffer(const Device& device, vk::DeviceSize size_bytes);
// That the host reads what was copied to.
Buffer make_readback_buffer(const Device& device, vk::DeviceSize size_bytes);

struct Image {
  vk::UniqueDeviceMemory memory;
  vk::UniqueImage image;
  vk::UniqueImageView view;
  vk::Extent2D size;
};

// Of a whole image.
vk::ImageMemoryBarrier image_barrier(vk::Image image, vk::AccessFlags before, vk::AccessFlags after,
                                     vk::ImageLayout from, vk::ImageLayout to);

// Four 32-bit floats a pixel; storage, and where copies are from.
Image make_image(const Device& device, vk::Extent2D size);

}  // namespace postpass
