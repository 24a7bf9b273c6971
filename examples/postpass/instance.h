#pragma once

#include <memory>
#include <span>
#include <vulkan/vulkan.hpp>

namespace postpass {

// A Vulkan instance; with `validate`, the Khronos layer prints its messages, of hazards between commands too,
// to stderr, and they are counted.
class Instance {
 public:
  Instance(std::span<const char* const> extensions, bool validate);
  ~Instance();
  Instance(const Instance&) = delete;
  Instance& operator=(const Instance&) = delete;

  vk::Instance get() const { return *instance_; }
  uint32_t messages() const { return messages_; }

 private:
  uint32_t messages_ = 0;
  vk::UniqueInstance instance_;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
};

}  // namespace postpass
