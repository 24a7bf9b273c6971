// Makes buffers and images with memory of their own.
#pragma once

#include <vulkan/vulkan.hpp>

#include "device.h"

namespace postpass {

struct Buffer {
  vk::UniqueDeviceMemory memory;
  vk::UniqueBuffer buffer;
  const float* mapped = nullptr;  // the values of a readback buffer
};

// Makes a buffer on the device, for storage and for copies in both directions.
Buffer make_buffer(const Device& device, vk::DeviceSize size_bytes);
// Makes a buffer for the device to copy to and the host to read.
Buffer make_readback_buffer(const Device& device, vk::DeviceSize size_bytes);

struct Image {
  vk::UniqueDeviceMemory memory;
  vk::UniqueImage image;
  vk::UniqueImageView view;
  vk::Extent2D size;
};

// Returns a barrier for a whole image.
vk::ImageMemoryBarrier image_barrier(vk::Image image, vk::AccessFlags before, vk::AccessFlags after,
                                     vk::ImageLayout from, vk::ImageLayout to);

// Makes an image of four 32-bit floats a pixel, for storage and for copies from it.
Image make_image(const Device& device, vk::Extent2D size);

}  // namespace postpass
