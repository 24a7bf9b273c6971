#include "engine/commands.h"

namespace raymeld {

Commands::Commands(const Device& device, VkCommandPoolCreateFlags flags) : device_(device) {
  auto info = vk_struct<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
  info.flags = flags;
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
  start(commands);
  return commands;
}

void Commands::restart(VkCommandBuffer commands) {
  check(device_.vk().ResetCommandBuffer(commands, 0), "resetting commands");
  start(commands);
}

void Commands::start(VkCommandBuffer commands) {
  const auto info = vk_struct<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
  check(device_.vk().BeginCommandBuffer(commands, &info), "recording commands");
}

void Commands::end(VkCommandBuffer commands) {
  check(device_.vk().EndCommandBuffer(commands), "recording commands");
}

void show_host(const Device& device, VkCommandBuffer commands) {
  auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  device.vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT,
                                 0, 1, &barrier, 0, nullptr, 0, nullptr);
}

namespace {

// Makes transfers wait for the shaders of earlier submits.
void begin_transfer(const Device& device, VkCommandBuffer commands) {
  auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
  device.vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT,
                                 VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 1, &barrier, 0, nullptr, 0, nullptr);
}

// Makes later shaders and the host see what transfers wrote.
void end_transfer(const Device& device, VkCommandBuffer commands) {
  auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT | VK_ACCESS_SHADER_READ_BIT;
  device.vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT,
                                 VK_PIPELINE_STAGE_HOST_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, 0, 1,
                                 &barrier, 0, nullptr, 0, nullptr);
}

// Submits what `record` records, and waits.
template <typename Record>
void do_now(const Device& device, const std::string& name, const Record& record) {
  Commands pool(device);
  const VkCommandBuffer commands = pool.begin(name);
  record(commands);
  pool.end(commands);
  device.submit_and_wait(commands);
}

}  // namespace

void record_copy(const Device& device, VkCommandBuffer commands, VkBuffer from, VkBuffer to,
                 const VkBufferCopy& region) {
  begin_transfer(device, commands);
  device.vk().CmdCopyBuffer(commands, from, to, 1, &region);
  end_transfer(device, commands);
}

void copy_now(const Device& device, VkBuffer from, VkBuffer to, const VkBufferCopy& region,
              const std::string& name) {
  do_now(device, name, [&](VkCommandBuffer commands) { record_copy(device, commands, from, to, region); });
}

void record_fill(const Device& device, VkCommandBuffer commands, VkBuffer to, const FillRegion& region) {
  begin_transfer(device, commands);
  device.vk().CmdFillBuffer(commands, to, region.offset_bytes, region.size_bytes, region.pattern);
  end_transfer(device, commands);
}

void fill_now(const Device& device, VkBuffer to, const FillRegion& region, const std::string& name) {
  do_now(device, name, [&](VkCommandBuffer commands) { record_fill(device, commands, to, region); });
}

}  // namespace raymeld
