#include "frames.h"

#include "allocations.h"

namespace postpass {

Slot::Slot(const Device& device, const Renderer& renderer, vk::CommandPool pool)
    : device_(device), renderer_(renderer) {
  const vk::Device vk = device.get();
  commands_ =
      std::move(vk.allocateCommandBuffersUnique({.commandPool = pool, .commandBufferCount = 1}).front());
  done_ = vk.createFenceUnique({}, counting_callbacks());
  queries_ = vk.createQueryPoolUnique({.queryType = vk::QueryType::eTimestamp, .queryCount = kStamps},
                                      counting_callbacks());
  acquired_ = vk.createSemaphoreUnique({}, counting_callbacks());
  const vk::Extent2D shown = renderer.shown().size;
  image_ = make_readback_buffer(device, sizeof(float) * 4 * shown.width * shown.height);
}

vk::CommandBuffer Slot::begin() {
  captured_ = false;
  commands_->begin({.flags = vk::CommandBufferUsageFlagBits::eOneTimeSubmit});
  return *commands_;
}

void Slot::record_copy() {
  captured_ = true;
  const vk::Extent2D size = renderer_.shown().size;
  commands_->copyImageToBuffer(
      *renderer_.shown().image, vk::ImageLayout::eTransferSrcOptimal, *image_.buffer,
      vk::BufferImageCopy{.imageSubresource = {vk::ImageAspectFlagBits::eColor, 0, 0, 1},
                          .imageExtent = {size.width, size.height, 1}});
  const vk::MemoryBarrier to_host{.srcAccessMask = vk::AccessFlagBits::eTransferWrite,
                                  .dstAccessMask = vk::AccessFlagBits::eHostRead};
  commands_->pipelineBarrier(vk::PipelineStageFlagBits::eTransfer, vk::PipelineStageFlagBits::eHost, {},
                             to_host, {}, {});
}

void Slot::submit(vk::Semaphore waits_for, vk::Semaphore signals) {
  commands_->end();
  const vk::PipelineStageFlags stage = vk::PipelineStageFlagBits::eTransfer;
  const vk::SubmitInfo info{.waitSemaphoreCount = waits_for ? 1u : 0u,
                            .pWaitSemaphores = &waits_for,
                            .pWaitDstStageMask = &stage,
                            .commandBufferCount = 1,
                            .pCommandBuffers = &*commands_,
                            .signalSemaphoreCount = signals ? 1u : 0u,
                            .pSignalSemaphores = &signals};
  device_.queue().submit(info, *done_);
  pending_ = true;
}

std::optional<FrameResult> Slot::finish() {
  if (!pending_) return {};
  const vk::Device vk = device_.get();
  (void)vk.waitForFences(*done_, true, UINT64_MAX);
  vk.resetFences(*done_);
  pending_ = false;
  std::array<uint64_t, kStamps> stamps;
  (void)vk.getQueryPoolResults(*queries_, 0, kStamps, sizeof(stamps), stamps.data(), sizeof(stamps[0]),
                               vk::QueryResultFlagBits::e64 | vk::QueryResultFlagBits::eWait);
  FrameResult result;
  for (uint32_t i = 0; i < kParts; ++i) result.part_ms[i] = device_.elapsed_ms(stamps[i], stamps[i + 1]);
  if (captured_) result.image = image_.mapped;
  return result;
}

Frames::Frames(const Device& device, const Renderer& renderer, uint32_t in_flight) {
  pool_ = device.get().createCommandPoolUnique({.flags = vk::CommandPoolCreateFlagBits::eResetCommandBuffer,
                                                .queueFamilyIndex = device.queue_family()});
  slots_.reserve(in_flight);
  for (uint32_t i = 0; i < in_flight; ++i) slots_.emplace_back(device, renderer, *pool_);
}

}  // namespace postpass
