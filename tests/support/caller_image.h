#pragma once

#include <functional>
#include <vector>

#include "caller_device.h"
#include "engine/commands.h"
#include "reference/reference.h"

namespace raymeld::test {

// Makes a Vulkan image as a renderer would hand it over: 2D, one level.
class CallerImage {
 public:
  CallerImage(const Device& device, VkFormat format, uint32_t width, uint32_t height,
              VkImageUsageFlags usage);
  ~CallerImage();
  CallerImage(const CallerImage&) = delete;
  CallerImage& operator=(const CallerImage&) = delete;

  VkImageView view() const { return view_; }
  uint32_t width() const { return width_; }
  uint32_t height() const { return height_; }
  // Writes all texels, row by row, and leaves the image in `layout`. Submits and waits.
  void write(const std::vector<std::byte>& texels, VkImageLayout layout);
  // Reads an image that is in GENERAL and whose writers have finished.
  std::vector<std::byte> read() const;

 private:
  struct Functions;
  void run(const std::function<void(VkCommandBuffer)>& record) const;
  void move(VkCommandBuffer commands, VkImageLayout from, VkImageLayout to) const;

  const Device& device_;
  uint32_t width_, height_;
  VkImage image_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  VkImageView view_ = VK_NULL_HANDLE;
};

}  // namespace raymeld::test
