#include "engine/commands.h"

namespace raymeld {

Commands::Commands(const Device& device) : device_(device) {
  auto info = vk_struct<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
  info.queueFamilyIndex = device.queue_family();
  check(device.vk().CreateCommandPool(device.handle(), &info, device.allocator(), &pool_),
        "creating a command pool");
}

Commands::~Commands() { device_.vk().DestroyCommandPool(device_.handle(), pool_, device_.allocator()); }

VkCommandBuffer Commands::begin(const std::string& name) {
  auto info = vk_struct<VkCommandBufferAllocateInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO);
  info.commandPool = pool_;
  info.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  info.commandBufferCount = 1;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  check(device_.vk().AllocateCommandBuffers(device_.handle(), &info, &commands),
        "allocating commands " + name);
  device_.name(VK_OBJECT_TYPE_COMMAND_BUFFER, commands, name);
  const auto begin = vk_struct<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
  check(device_.vk().BeginCommandBuffer(commands, &begin), "recording " + name);
  return commands;
}

void Commands::end(VkCommandBuffer commands) {
  check(device_.vk().EndCommandBuffer(commands), "recording commands");
}

}  // namespace raymeld
