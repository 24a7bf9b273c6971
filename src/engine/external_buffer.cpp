#include "engine/external_buffer.h"

#include <bit>
#include <cerrno>
#include <cstring>

#include "platform/files.h"

namespace raymeld {
namespace {

constexpr VkBufferUsageFlags kUsage =
    VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
constexpr const char* kWhat = "importing memory";

// Returns whether such memory must be one buffer's alone. Throws Error where it cannot be imported.
bool must_be_dedicated(const Device& device, const MemoryFd& from) {
  auto info =
      vk_struct<VkPhysicalDeviceExternalBufferInfo>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_EXTERNAL_BUFFER_INFO);
  info.usage = kUsage;
  info.handleType = from.type;
  auto found = vk_struct<VkExternalBufferProperties>(VK_STRUCTURE_TYPE_EXTERNAL_BUFFER_PROPERTIES);
  device.vk().GetPhysicalDeviceExternalBufferProperties(device.physical_device(), &info, &found);
  const VkExternalMemoryFeatureFlags features = found.externalMemoryProperties.externalMemoryFeatures;
  if (!(features & VK_EXTERNAL_MEMORY_FEATURE_IMPORTABLE_BIT))
    throw Error("{}: device {} cannot import storage buffers of handle type {:#x}", kWhat, device.info().name,
                uint32_t(from.type));
  return features & VK_EXTERNAL_MEMORY_FEATURE_DEDICATED_ONLY_BIT;
}

// Returns the exporter's memory type; a dma_buf may have any type that both the device and the buffer allow.
uint32_t memory_type_of(const Device& device, const MemoryFd& from, uint32_t allowed) {
  if (from.type == VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT) {
    if (from.memory_type < 32 && (allowed & 1u << from.memory_type)) return from.memory_type;
    throw Error(
        "{}: storage buffers of device {} cannot lie in memory of type {}, expected one of the types {:#b}",
        kWhat, device.info().name, from.memory_type, allowed);
  }
  auto found = vk_struct<VkMemoryFdPropertiesKHR>(VK_STRUCTURE_TYPE_MEMORY_FD_PROPERTIES_KHR);
  check(device.vk().GetMemoryFdPropertiesKHR(device.handle(), from.type, from.fd, &found), kWhat);
  if (!(found.memoryTypeBits & allowed))
    throw Error("{}: device {} has no memory type for a storage buffer in this dma_buf", kWhat,
                device.info().name);
  return uint32_t(std::countr_zero(found.memoryTypeBits & allowed));
}

}  // namespace

ExternalBuffer::ExternalBuffer(const Device& device, const MemoryFd& from) : device_(device) {
  try {
    create(from);
  } catch (...) {
    destroy();
    throw;
  }
}

void ExternalBuffer::destroy() {
  device_.vk().DestroyBuffer(device_.handle(), buffer_, device_.allocator());
  device_.vk().FreeMemory(device_.handle(), memory_, device_.allocator());
}

void ExternalBuffer::create(const MemoryFd& from) {
  if (!device_.info().external_memory_fd)
    throw Error("{}: VK_KHR_external_memory_fd is not enabled on device {}", kWhat, device_.info().name);
  if (from.type == VK_EXTERNAL_MEMORY_HANDLE_TYPE_DMA_BUF_BIT_EXT && !device_.info().dma_buf)
    throw Error("{}: device {} has no VK_EXT_external_memory_dma_buf", kWhat, device_.info().name);
  MemoryFd memory = from;
  memory.dedicated |= must_be_dedicated(device_, from);
  auto external =
      vk_struct<VkExternalMemoryBufferCreateInfo>(VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO);
  external.handleTypes = from.type;
  auto info = vk_struct<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, &external);
  info.size = from.size_bytes;
  info.usage = kUsage;
  const VulkanFunctions& vk = device_.vk();
  check(vk.CreateBuffer(device_.handle(), &info, device_.allocator(), &buffer_), kWhat);
  device_.name(VK_OBJECT_TYPE_BUFFER, buffer_, "imported buffer");
  VkMemoryRequirements needs;
  vk.GetBufferMemoryRequirements(device_.handle(), buffer_, &needs);
  if (from.offset_bytes % needs.alignment != 0 || from.offset_bytes > from.memory_size_bytes ||
      from.memory_size_bytes - from.offset_bytes < needs.size ||
      (memory.dedicated && (from.offset_bytes != 0 || from.memory_size_bytes != needs.size)))
    throw Error("{}: a buffer of {} bytes at offset {} of {} bytes, expected {} bytes for it at {}", kWhat,
                from.size_bytes, from.offset_bytes, from.memory_size_bytes, needs.size,
                memory.dedicated ? "offset 0 of as many bytes, since the memory is dedicated"
                                 : fmt::format("a multiple of {}", needs.alignment));
  import(memory, needs);
  check(vk.BindBufferMemory(device_.handle(), buffer_, memory_, from.offset_bytes), kWhat);
}

// Imports a copy of the descriptor, since Vulkan owns an imported one even if a later step fails.
void ExternalBuffer::import(const MemoryFd& from, const VkMemoryRequirements& needs) {
  auto dedicated = vk_struct<VkMemoryDedicatedAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_DEDICATED_ALLOCATE_INFO);
  dedicated.buffer = buffer_;
  auto import = vk_struct<VkImportMemoryFdInfoKHR>(VK_STRUCTURE_TYPE_IMPORT_MEMORY_FD_INFO_KHR,
                                                   from.dedicated ? &dedicated : nullptr);
  import.handleType = from.type;
  auto info = vk_struct<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, &import);
  info.allocationSize = from.memory_size_bytes;
  info.memoryTypeIndex = memory_type_of(device_, from, needs.memoryTypeBits);
  import.fd = copy_descriptor(from.fd);
  if (import.fd < 0) throw Error("{}: descriptor {}: {}", kWhat, from.fd, std::strerror(errno));
  const VkResult imported =
      device_.vk().AllocateMemory(device_.handle(), &info, device_.allocator(), &memory_);
  if (imported != VK_SUCCESS) close_descriptor(import.fd);
  check(imported, fmt::format("{} on {}", kWhat, device_.info().name));
  device_.name(VK_OBJECT_TYPE_DEVICE_MEMORY, memory_, "imported buffer");
}

}  // namespace raymeld
