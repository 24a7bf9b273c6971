// Counts what is allocated: a frame of a real-time renderer allocates nothing.
#pragma once

#include <cstdint>
#include <vulkan/vulkan.hpp>

namespace postpass {

struct Allocations {
  uint64_t host = 0;    // operator new, of this program and of the libraries it loads
  uint64_t vulkan = 0;  // of the driver, for objects made with counting_callbacks()

  bool operator==(const Allocations&) const = default;
  Allocations operator-(const Allocations& other) const { return {host - other.host, vulkan - other.vulkan}; }
  Allocations& operator+=(const Allocations& other) {
    host += other.host;
    vulkan += other.vulkan;
    return *this;
  }
};

Allocations allocations_so_far();

// For all objects on the device, raymeld's too, but command pools: where a driver keeps what is recorded,
// with the callbacks of the pool or of the device, is its own affair.
const vk::AllocationCallbacks& counting_callbacks();

}  // namespace postpass
