#include "resources.h"

#include "allocations.h"

namespace postpass {
namespace {

vk::UniqueDeviceMemory allocate(const Device& device, const vk::MemoryRequirements& needs,
                                vk::MemoryPropertyFlags wanted, vk::MemoryPropertyFlags better = {}) {
  return device.get().allocateMemoryUnique(
      {.allocationSize = needs.size,
       .memoryTypeIndex = device.memory_type(needs.memoryTypeBits, wanted, better)},
      counting_callbacks());
}

Buffer make(const Device& device, vk::DeviceSize size_bytes, vk::MemoryPropertyFlags wanted,
            vk::MemoryPropertyFlags better = {}) {
  const auto usage = vk::BufferUsageFlagBits::eStorageBuffer | vk::BufferUsageFlagBits::eTransferSrc |
                     vk::BufferUsageFlagBits::eTransferDst;
  Buffer made;
  made.buffer = device.get().createBufferUnique({.size = size_bytes, .usage = usage}, counting_callbacks());
  made.memory = allocate(device, device.get().getBufferMemoryRequirements(*made.buffer), wanted, better);
  device.get().bindBufferMemory(*made.buffer, *made.memory, 0);
  return made;
}

}  // namespace

Buffer make_buffer(const Device& device, vk::DeviceSize size_bytes) {
  return make(device, size_bytes, vk::MemoryPropertyFlagBits::eDeviceLocal);
}

Buffer make_readback_buffer(const Device& device, vk::DeviceSize size_bytes) {
  Buffer made = make(device, size_bytes,
                     vk::MemoryPropertyFlagBits::eHostVisible | vk::MemoryPropertyFlagBits::eHostCoherent,
                     vk::MemoryPropertyFlagBits::eHostCached);
  made.mapped = static_cast<const float*>(device.get().mapMemory(*made.memory, 0, VK_WHOLE_SIZE));
  return made;
}

Image make_image(const Device& device, vk::Extent2D size) {
  constexpr auto kFormat = vk::Format::eR32G32B32A32Sfloat;
  Image made;
  made.size = size;
  made.image = device.get().createImageUnique(
      {.imageType = vk::ImageType::e2D,
       .format = kFormat,
       .extent = {size.width, size.height, 1},
       .mipLevels = 1,
       .arrayLayers = 1,
       .usage = vk::ImageUsageFlagBits::eStorage | vk::ImageUsageFlagBits::eTransferSrc},
      counting_callbacks());
  made.memory = allocate(device, device.get().getImageMemoryRequirements(*made.image),
                         vk::MemoryPropertyFlagBits::eDeviceLocal);
  device.get().bindImageMemory(*made.image, *made.memory, 0);
  made.view =
      device.get().createImageViewUnique({.image = *made.image,
                                          .viewType = vk::ImageViewType::e2D,
                                          .format = kFormat,
                                          .subresourceRange = {vk::ImageAspectFlagBits::eColor, 0, 1, 0, 1}},
                                         counting_callbacks());
  return made;
}

vk::ImageMemoryBarrier image_barrier(vk::Image image, vk::AccessFlags before, vk::AccessFlags after,
                                     vk::ImageLayout from, vk::ImageLayout to) {
  return {.srcAccessMask = before,
          .dstAccessMask = after,
          .oldLayout = from,
          .newLayout = to,
          .srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
          .dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
          .image = image,
          .subresourceRange = {vk::ImageAspectFlagBits::eColor, 0, 1, 0, 1}};
}

}  // namespace postpass
