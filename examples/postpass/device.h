#pragma once

#include <raymeld/raymeld.hpp>
#include <string>
#include <vulkan/vulkan.hpp>

#include "instance.h"

namespace postpass {

// Holds a device with a queue for graphics and compute, and raymeld on it. The queue can present to
// `surface`, which may be null.
class Device {
 public:
  // `index` counts the suitable devices, and starts again after the last.
  Device(const Instance& instance, uint32_t index, vk::SurfaceKHR surface);
  ~Device() { vkDeviceWaitIdle(*device_); }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  vk::PhysicalDevice physical() const { return physical_; }
  vk::Device get() const { return *device_; }
  vk::Queue queue() const { return queue_; }
  uint32_t queue_family() const { return queue_family_; }
  const raymeld::Context& raymeld() const { return *context_; }
  const std::string& name() const { return name_; }
  // Returns the time between two timestamps of the queue.
  double elapsed_ms(uint64_t from, uint64_t to) const {
    return 1e-6 * timestamp_period_ns_ * double((to - from) & timestamp_mask_);
  }

  // Returns a memory type of `bits` that has all of `wanted` and, if there is one, all of `better`. Throws if
  // no type has all of `wanted`.
  uint32_t memory_type(uint32_t bits, vk::MemoryPropertyFlags wanted,
                       vk::MemoryPropertyFlags better = {}) const;

 private:
  vk::PhysicalDevice physical_;
  uint32_t queue_family_ = 0;
  std::string name_;
  double timestamp_period_ns_ = 0;
  uint64_t timestamp_mask_ = 0;
  vk::UniqueDevice device_;
  vk::Queue queue_;
  std::unique_ptr<raymeld::Context> context_;
};

}  // namespace postpass
