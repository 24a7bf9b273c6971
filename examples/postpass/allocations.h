// Counts what is allocated: a frame of a real-time renderer allocates nothing.
#pragma once

#include <cstdint>
#include <vulkan/vulkan.hpp>

namespace postpass {

struct Allocations {
  uint64_t host = 0;    // calls of operator new, by this program and the libraries that it loads
  uint64_t vulkan = 0;  // allocations of the driver, for objects made with counting_callbacks()

  bool operator==(const Allocations&) const = default;
  Allocations operator-(const Allocations& other) const { return {host - other.host, vulkan - other.vulkan}; }
  Allocations& operator+=(const Allocations& other) {
    host += other.host;
    vulkan += other.vulkan;
    return *this;
  }
};

Allocations allocations_so_far();

// Returns the callbacks for all objects on the device, raymeld's too, except command pools: a driver may
// allocate recorded commands with the callbacks of the pool or with those of the device.
const vk::AllocationCallbacks& counting_callbacks();

}  // namespace postpass
