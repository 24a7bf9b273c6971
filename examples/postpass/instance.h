#pragma once

#include <memory>
#include <span>
#include <vulkan/vulkan.hpp>

namespace postpass {

// Holds a Vulkan instance. With `validate`, the messages of the Khronos layer, including those about hazards
// between commands, are printed to stderr and counted.
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
