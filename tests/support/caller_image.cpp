#include "caller_image.h"

#include <algorithm>
#include <bit>

#include "engine/buffer.h"

namespace raymeld::test {
namespace {

constexpr VkImageSubresourceRange kAll{VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
constexpr uint64_t kMostTexelBytes = 16;

}  // namespace

// Holds the Vulkan functions that raymeld itself never calls.
struct CallerImage::Functions {
  PFN_vkCreateImage CreateImage;
  PFN_vkDestroyImage DestroyImage;
  PFN_vkCreateImageView CreateImageView;
  PFN_vkDestroyImageView DestroyImageView;
  PFN_vkGetImageMemoryRequirements GetImageMemoryRequirements;
  PFN_vkBindImageMemory BindImageMemory;
  PFN_vkCmdCopyBufferToImage CmdCopyBufferToImage;
  PFN_vkCmdCopyImageToBuffer CmdCopyImageToBuffer;

  explicit Functions(const Device& device) {
    const auto load = [&](auto& function, const char* name) {
      function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(
          device.vk().GetDeviceProcAddr(device.handle(), name));
    };
    load(CreateImage, "vkCreateImage");
    load(DestroyImage, "vkDestroyImage");
    load(CreateImageView, "vkCreateImageView");
    load(DestroyImageView, "vkDestroyImageView");
    load(GetImageMemoryRequirements, "vkGetImageMemoryRequirements");
    load(BindImageMemory, "vkBindImageMemory");
    load(CmdCopyBufferToImage, "vkCmdCopyBufferToImage");
    load(CmdCopyImageToBuffer, "vkCmdCopyImageToBuffer");
  }
};

CallerImage::CallerImage(const Device& device, VkFormat format, uint32_t width, uint32_t height,
                         VkImageUsageFlags usage)
    : device_(device), width_(width), height_(height) {
  const Functions vk(device);
  auto image = vk_struct<VkImageCreateInfo>(VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO);
  image.imageType = VK_IMAGE_TYPE_2D;
  image.format = format;
  image.extent = {width, height, 1};
  image.mipLevels = image.arrayLayers = 1;
  image.samples = VK_SAMPLE_COUNT_1_BIT;
  image.usage = usage | VK_IMAGE_USAGE_TRANSFER_SRC_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
  check(vk.CreateImage(device.handle(), &image, nullptr, &image_), "creating an image");
  VkMemoryRequirements needs;
  vk.GetImageMemoryRequirements(device.handle(), image_, &needs);
  auto memory = vk_struct<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO);
  memory.allocationSize = needs.size;
  memory.memoryTypeIndex = uint32_t(std::countr_zero(needs.memoryTypeBits));
  check(device.vk().AllocateMemory(device.handle(), &memory, nullptr, &memory_), "allocating an image");
  check(vk.BindImageMemory(device.handle(), image_, memory_, 0), "binding an image");
  auto view = vk_struct<VkImageViewCreateInfo>(VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO);
  view.image = image_;
  view.viewType = VK_IMAGE_VIEW_TYPE_2D;
  view.format = format;
  view.subresourceRange = kAll;
  check(vk.CreateImageView(device.handle(), &view, nullptr, &view_), "viewing an image");
}

CallerImage::~CallerImage() {
  const Functions vk(device_);
  vk.DestroyImageView(device_.handle(), view_, nullptr);
  vk.DestroyImage(device_.handle(), image_, nullptr);
  device_.vk().FreeMemory(device_.handle(), memory_, nullptr);
}

void CallerImage::run(const std::function<void(VkCommandBuffer)>& record) const {
  Commands pool(device_);
  const VkCommandBuffer commands = pool.begin("image");
  record(commands);
  pool.end(commands);
  device_.submit_and_wait(commands);
}

void CallerImage::move(VkCommandBuffer commands, VkImageLayout from, VkImageLayout to) const {
  auto barrier = vk_struct<VkImageMemoryBarrier>(VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER);
  barrier.srcAccessMask = barrier.dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT;
  barrier.oldLayout = from;
  barrier.newLayout = to;
  barrier.srcQueueFamilyIndex = barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.image = image_;
  barrier.subresourceRange = kAll;
  device_.vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT,
                                  VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 0, nullptr, 0, nullptr, 1, &barrier);
}

void CallerImage::write(const std::vector<std::byte>& texels, VkImageLayout layout) {
  const Buffer host(device_, texels.size(), Memory::kUpload, "texels");
  std::ranges::copy(texels, static_cast<std::byte*>(host.mapped()));
  run([&](VkCommandBuffer commands) {
    const VkBufferImageCopy region{0, 0, 0, {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1}, {}, {width_, height_, 1}};
    move(commands, VK_IMAGE_LAYOUT_UNDEFINED, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL);
    Functions(device_).CmdCopyBufferToImage(commands, host.handle(), image_,
                                            VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &region);
    move(commands, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, layout);
  });
}

std::vector<std::byte> CallerImage::read() const {
  const Buffer host(device_, kMostTexelBytes * width_ * height_, Memory::kReadback, "texels");
  run([&](VkCommandBuffer commands) {
    const VkBufferImageCopy region{0, 0, 0, {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1}, {}, {width_, height_, 1}};
    move(commands, VK_IMAGE_LAYOUT_GENERAL, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL);
    Functions(device_).CmdCopyImageToBuffer(commands, image_, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
                                            host.handle(), 1, &region);
    move(commands, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, VK_IMAGE_LAYOUT_GENERAL);
    auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
    barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
    device_.vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0,
                                    1, &barrier, 0, nullptr, 0, nullptr);
  });
  host.invalidate();
  const auto* texels = static_cast<const std::byte*>(host.mapped());
  return {texels, texels + host.size_bytes()};
}

}  // namespace raymeld::test
