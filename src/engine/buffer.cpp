#include "engine/buffer.h"

#include <utility>

#include "error.h"
#include "numbers.h"

namespace raymeld {
namespace {

// Throws OutOfMemory for the host's memory too: some drivers take memory that the host sees from there.
void check_allocation(VkResult result, const std::string& what) {
  if (result == VK_ERROR_OUT_OF_HOST_MEMORY) throw OutOfMemory("{}: {}", what, result_name(result));
  check(result, what);
}

}  // namespace

std::optional<uint32_t> memory_type(const VkPhysicalDeviceMemoryProperties& types, uint32_t allowed,
                                    Memory memory) {
  constexpr VkMemoryPropertyFlags kLocal = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT,
                                  kVisible = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT,
                                  kCoherent = VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                                  kCached = VK_MEMORY_PROPERTY_HOST_CACHED_BIT;
  struct Wish {
    VkMemoryPropertyFlags required, preferred;
  };
  const auto wish_for = [&]() -> Wish {
    switch (memory) {
      case Memory::kDevice:
        return {kLocal, 0};
      case Memory::kUpload:
        return {kVisible | kCoherent, 0};
      case Memory::kReadback:
        return {kVisible, kCached};
      case Memory::kShared:
        return {kVisible | kCoherent, kLocal};
    }
    return {};
  };
  const auto [required, preferred] = wish_for();
  for (const VkMemoryPropertyFlags wanted : {required | preferred, required}) {
    for (uint32_t i = 0; i < types.memoryTypeCount; ++i) {
      if ((allowed & (1u << i)) && (types.memoryTypes[i].propertyFlags & wanted) == wanted) return i;
    }
  }
  return {};
}

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
    const std::optional<uint32_t> type = memory_type(device.memory(), needs.memoryTypeBits, memory);
    if (!type) throw Error("device {} has no memory type for {}", device.info().name, name);
    allocation.memoryTypeIndex = *type;
    check_allocation(vk.AllocateMemory(device.handle(), &allocation, device.allocator(), &memory_), what);
    device.name(VK_OBJECT_TYPE_DEVICE_MEMORY, memory_, name);
    bind(memory_, 0, what);
    const VkMemoryPropertyFlags flags = device.memory().memoryTypes[allocation.memoryTypeIndex].propertyFlags;
    coherent_ = flags & VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    if (flags & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT) {
      check(vk.MapMemory(device.handle(), memory_, 0, VK_WHOLE_SIZE, 0, &mapped_), what);
    }
  } catch (const OutOfMemory&) {
    *this = Buffer();
    // The part of the device's memory that the host sees may be small, and full.
    const auto type_for = [&](Memory kind) { return memory_type(device.memory(), ~0u, kind); };
    if (memory != Memory::kShared || type_for(Memory::kShared) == type_for(Memory::kUpload)) throw;
    *this = Buffer(device, size_bytes, Memory::kUpload, name);
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
