#include "allocations.h"

#include <malloc.h>

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <new>

namespace {

std::atomic<uint64_t> host_count = 0, vulkan_count = 0;

void* counted_new(size_t size, size_t alignment) {
  ++host_count;
  void* const memory = std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
  if (!memory && size > 0) throw std::bad_alloc();
  return memory;
}

void* VKAPI_CALL allocate(void*, size_t size, size_t alignment, VkSystemAllocationScope) {
  ++vulkan_count;
  alignment = std::max(alignment, alignof(std::max_align_t));
  return std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
}

void VKAPI_CALL release(void*, void* memory) { std::free(memory); }

void* VKAPI_CALL reallocate(void* user, void* old, size_t size, size_t alignment,
                            VkSystemAllocationScope scope) {
  if (size == 0) {
    release(user, old);
    return nullptr;
  }
  void* const memory = allocate(user, size, alignment, scope);
  if (memory && old) {
    std::memcpy(memory, old, std::min(size, malloc_usable_size(old)));
    release(user, old);
  }
  return memory;
}

}  // namespace

void* operator new(size_t size) { return counted_new(size, alignof(std::max_align_t)); }
void* operator new(size_t size, std::align_val_t alignment) { return counted_new(size, size_t(alignment)); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, size_t, std::align_val_t) noexcept { std::free(memory); }

namespace postpass {

Allocations allocations_so_far() { return {host_count, vulkan_count}; }

const vk::AllocationCallbacks& counting_callbacks() {
  static const vk::AllocationCallbacks callbacks{
      .pfnAllocation = allocate, .pfnReallocation = reallocate, .pfnFree = release};
  return callbacks;
}

}  // namespace postpass
