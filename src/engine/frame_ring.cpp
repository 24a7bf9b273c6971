#include "engine/frame_ring.h"

#include <algorithm>

namespace raymeld {
namespace {

// Holds semaphores and values in the lists that Vulkan takes.
struct SemaphoreLists {
  std::vector<VkSemaphore> semaphores;
  std::vector<uint64_t> values;
  bool has_timeline = false;

  explicit SemaphoreLists(std::span<const SemaphoreValue> all) {
    for (const auto& [semaphore, value] : all) {
      semaphores.push_back(semaphore);
      values.push_back(value);
      has_timeline |= value != 0;
    }
  }
  uint32_t count() const { return static_cast<uint32_t>(semaphores.size()); }
};

}  // namespace

FrameRing::FrameRing(const Device& device, uint32_t frames)
    : device_(device), pool_(device, VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT), frames_(frames) {
  const auto info = vk_struct<VkFenceCreateInfo>(VK_STRUCTURE_TYPE_FENCE_CREATE_INFO);
  try {
    for (Frame& frame : frames_) {
      check(device.vk().CreateFence(device.handle(), &info, device.allocator(), &frame.fence),
            "creating a fence");
    }
  } catch (...) {
    destroy_fences();
    throw;
  }
}

FrameRing::~FrameRing() {
  for (Frame& frame : frames_) {
    // The result does not matter: a lost device does nothing any more.
    if (frame.is_pending) device_.vk().WaitForFences(device_.handle(), 1, &frame.fence, VK_TRUE, UINT64_MAX);
  }
  destroy_fences();
}

void FrameRing::destroy_fences() {
  for (const Frame& frame : frames_)
    device_.vk().DestroyFence(device_.handle(), frame.fence, device_.allocator());
}

void FrameRing::wait_for(Frame& frame) {
  if (!frame.is_pending) return;
  check(device_.vk().WaitForFences(device_.handle(), 1, &frame.fence, VK_TRUE, UINT64_MAX),
        "waiting for a frame on " + device_.info().name);
  check(device_.vk().ResetFences(device_.handle(), 1, &frame.fence), "resetting a fence");
  frame.is_pending = false;
}

bool FrameRing::is_pending(uint32_t index) const {
  const Frame& frame = frames_.at(index);
  return frame.is_pending && device_.vk().GetFenceStatus(device_.handle(), frame.fence) == VK_NOT_READY;
}

void FrameRing::wait() {
  for (Frame& frame : frames_) wait_for(frame);
}

VkCommandBuffer FrameRing::begin(uint32_t index) {
  Frame& frame = frames_.at(index);
  wait_for(frame);
  if (frame.commands) {
    pool_.restart(frame.commands);
  } else {
    frame.commands = pool_.begin(fmt::format("frame {}", index));
  }
  return frame.commands;
}

void FrameRing::submit(uint32_t index, std::span<const SemaphoreValue> wait,
                       std::span<const SemaphoreValue> signal) {
  Frame& frame = frames_.at(index);
  pool_.end(frame.commands);
  const SemaphoreLists waits(wait), signals(signal);
  const std::vector<VkPipelineStageFlags> stages(wait.size(), VK_PIPELINE_STAGE_ALL_COMMANDS_BIT);
  auto timeline = vk_struct<VkTimelineSemaphoreSubmitInfo>(VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO);
  timeline.waitSemaphoreValueCount = waits.count();
  timeline.pWaitSemaphoreValues = waits.values.data();
  timeline.signalSemaphoreValueCount = signals.count();
  timeline.pSignalSemaphoreValues = signals.values.data();
  auto info = vk_struct<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  if (waits.has_timeline || signals.has_timeline) info.pNext = &timeline;
  info.waitSemaphoreCount = waits.count();
  info.pWaitSemaphores = waits.semaphores.data();
  info.pWaitDstStageMask = stages.data();
  info.commandBufferCount = 1;
  info.pCommandBuffers = &frame.commands;
  info.signalSemaphoreCount = signals.count();
  info.pSignalSemaphores = signals.semaphores.data();
  device_.submit(info, frame.fence);
  frame.is_pending = true;
}

}  // namespace raymeld
