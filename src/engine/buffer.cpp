#include "engine/buffer.h"

#include <utility>

#include "error.h"
#include "numbers.h"

namespace raymeld {
namespace {

// Returns the first memory type that has `required` and `preferred`, else the first that has `required`.
uint32_t find_memory_type(const Device& device, uint32_t allowed, VkMemoryPropertyFlags required,
                          VkMemoryPropertyFlags preferred, const std::string& name) {
  const VkPhysicalDeviceMemoryProperties& memory = device.memory();
  for (VkMemoryPropertyFlags wanted : {required | preferred, required}) {
    for (uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
      if ((allowed & (1u << i)) && (memory.memoryTypes[i].propertyFlags & wanted) == wanted) return i;
    }
  }
  throw Error("device {} has no memory type for {}", device.info().name, name);
}

uint32_t memory_type_for(const Device& device, uint32_t allowed, Memory memory, const std::string& name) {
  constexpr VkMemoryPropertyFlags kHost =
      VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  switch (memory) {
    case Memory::kDevice:
      return find_memory_type(device, allowed, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, 0, name);
    case Memory::kUpload:
      return find_memory_type(device, allowed, kHost, 0, name);
    case Memory::kReadback:
      return find_memory_type(device, allowed, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT,
                              VK_MEMORY_PROPERTY_HOST_CACHED_BIT, name);
  }
  throw Error("unknown memory kind for {}", name);
}

// Throws OutOfMemory for the host's memory too: some drivers take memory that the host sees from there.
void check_allocation(VkResult result, const std::string& what) {
  if (result == VK_ERROR_OUT_OF_HOST_MEMORY) throw OutOfMemory("{}: {}", what, result_name(result));
  check(result, what);
}

}  // namespace

// Creates the buffer without memory.
VkMemoryRequirements Buffer::create(const Device& device, const std::string& name, const std::string& what) {
  device_ = &device;
  auto info = vk_struct<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO);
  info.size = size_bytes_;
  info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
               VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  if (device.info().buffer_device_address) info.usage |= VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
  check(device.vk().CreateBuffer(device.handle(), &info, device.allocator(), &buffer_), what);
  device.name(VK_OBJECT_TYPE_BUFFER, buffer_, name);
  VkMemoryRequirements needs;
  device.vk().GetBufferMemoryRequirements(device.handle(), buffer_, &needs);
  return needs;
}

void Buffer::bind(VkDeviceMemory memory, uint64_t offset_bytes, const std::string& what) {
  const VulkanFunctions& vk = device_->vk();
  check(vk.BindBufferMemory(device_->handle(), buffer_, memory, offset_bytes), what);
  if (!device_->info().buffer_device_address) return;
  auto address = vk_struct<VkBufferDeviceAddressInfo>(VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO);
  address.buffer = buffer_;
  address_ = vk.GetBufferDeviceAddress(device_->handle(), &address);
}

Buffer::Buffer(const Device& device, uint64_t size_bytes, Memory memory, const std::string& name)
    : size_bytes_(size_bytes) {
  const VulkanFunctions& vk = device.vk();
  const std::string what =
      fmt::format("allocating {:.1f} MiB for {} on {}", size_bytes / kMebibyte, name, device.info().name);
  if (size_bytes > device.info().max_allocation_bytes) {
    throw Error("{}: the device allocates at most {:.1f} MiB at once", what,
                device.info().max_allocation_bytes / kMebibyte);
  }
  try {
    const VkMemoryRequirements needs = create(device, name, what);
    auto flags_info = vk_struct<VkMemoryAllocateFlagsInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO);
    flags_info.flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT;
    auto allocation = vk_struct<VkMemoryAllocateInfo>(
        VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, device.info().buffer_device_address ? &flags_info : nullptr);
    allocation.allocationSize = needs.size;
    allocation.memoryTypeIndex = memory_type_for(device, needs.memoryTypeBits, memory, name);
    check_allocation(vk.AllocateMemory(device.handle(), &allocation, device.allocator(), &memory_), what);
    device.name(VK_OBJECT_TYPE_DEVICE_MEMORY, memory_, name);
    bind(memory_, 0, what);
    const VkMemoryPropertyFlags flags = device.memory().memoryTypes[allocation.memoryTypeIndex].propertyFlags;
    coherent_ = flags & VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    if (flags & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT) {
      check(vk.MapMemory(device.handle(), memory_, 0, VK_WHOLE_SIZE, 0, &mapped_), what);
    }
  } catch (...) {
    *this = Buffer();
    throw;
  }
}

Buffer::Buffer(const Device& device, uint64_t size_bytes, const MemoryRange& memory, const std::string& name)
    : size_bytes_(size_bytes) {
  const std::string what = fmt::format("placing {} in the caller's memory on {}", name, device.info().name);
  try {
    const VkMemoryRequirements needs = create(device, name, what);
    if (memory.offset_bytes % needs.alignment != 0 || memory.size_bytes < needs.size) {
      throw Error("{}: the memory has {} bytes at offset {}, expected {} bytes at a multiple of {}", what,
                  memory.size_bytes, memory.offset_bytes, needs.size, needs.alignment);
    }
    bind(memory.memory, memory.offset_bytes, what);
  } catch (...) {
    *this = Buffer();
    throw;
  }
}

VkMemoryRequirements Buffer::requirements(const Device& device, uint64_t size_bytes) {
  Buffer buffer;
  buffer.size_bytes_ = size_bytes;
  return buffer.create(device, "requirements", "asking what memory a buffer needs");
}

Buffer::~Buffer() {
  if (!device_) return;
  const VulkanFunctions& vk = device_->vk();
  if (buffer_) vk.DestroyBuffer(device_->handle(), buffer_, device_->allocator());
  if (memory_) vk.FreeMemory(device_->handle(), memory_, device_->allocator());
}

Buffer& Buffer::operator=(Buffer&& other) noexcept {
  std::swap(device_, other.device_);
  std::swap(buffer_, other.buffer_);
  std::swap(memory_, other.memory_);
  std::swap(mapped_, other.mapped_);
  std::swap(address_, other.address_);
  std::swap(size_bytes_, other.size_bytes_);
  std::swap(coherent_, other.coherent_);
  return *this;
}

VkMappedMemoryRange Buffer::whole() const {
  auto range = vk_struct<VkMappedMemoryRange>(VK_STRUCTURE_TYPE_MAPPED_MEMORY_RANGE);
  range.memory = memory_;
  range.size = VK_WHOLE_SIZE;
  return range;
}

void Buffer::flush() const {
  if (coherent_) return;
  const VkMappedMemoryRange range = whole();
  check(device_->vk().FlushMappedMemoryRanges(device_->handle(), 1, &range), "uploading");
}

void Buffer::invalidate() const {
  if (coherent_) return;
  const VkMappedMemoryRange range = whole();
  check(device_->vk().InvalidateMappedMemoryRanges(device_->handle(), 1, &range), "reading back");
}

}  // namespace raymeld
