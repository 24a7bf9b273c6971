#include "renderer.h"

#include <cstring>
#include <stdexcept>

namespace postpass {
namespace {

vk::Extent2D small_size_of(vk::Extent2D size, uint32_t scale) {
  return {(size.width + scale - 1) / scale, (size.height + scale - 1) / scale};
}

// Returns the samples a pixel of LRHS.
uint32_t lrhs_samples_of(const RendererOptions& options, uint32_t scale) {
  return options.lrhs_samples ? options.lrhs_samples : scale * scale;
}

raymeld_fusion_desc fusion_desc(vk::Extent2D small, uint32_t scale, const RendererOptions& options) {
  raymeld_fusion_desc desc;
  desc.height = small.height;
  desc.width = small.width;
  desc.precision = options.precision;
  desc.lrhs_sampling = RAYMELD_SAMPLING_CENTERED;
  desc.lrhs_spp = float(lrhs_samples_of(options, scale));
  desc.hrls_spp = float(options.hrls_samples);
  desc.compute_variance = VK_TRUE;
  desc.temporal = desc.motion_depth = options.history;
  return desc;
}

std::array<Buffer, kShown> make_buffers(const Device& device, vk::Extent2D small, vk::Extent2D full) {
  const auto bytes = [](vk::Extent2D size, uint32_t channels) {
    return vk::DeviceSize{sizeof(float)} * channels * size.width * size.height;
  };
  std::array<Buffer, kShown> buffers;
  buffers[kConstants] = make_buffer(device, sizeof(Constants));
  buffers[kLrhs] = make_buffer(device, bytes(small, 3));
  buffers[kHrls] = make_buffer(device, bytes(full, kHrlsChannels));
  buffers[kMotion] = make_buffer(device, bytes(full, 4));
  buffers[kFused] = make_buffer(device, bytes(full, 3));
  buffers[kAccumulated] = make_buffer(device, bytes(full, 3));
  return buffers;
}

using Stage = vk::PipelineStageFlagBits;
using Access = vk::AccessFlagBits;

void barrier(vk::CommandBuffer commands, vk::PipelineStageFlags before, vk::AccessFlags written,
             vk::PipelineStageFlags after, vk::AccessFlags used) {
  commands.pipelineBarrier(before, after, {},
                           vk::MemoryBarrier{.srcAccessMask = written, .dstAccessMask = used}, {}, {});
}

// Separates passes of which the later ones read what the earlier ones wrote, or overwrite what they read.
void barrier(vk::CommandBuffer commands) {
  barrier(commands, Stage::eComputeShader, Access::eShaderWrite, Stage::eComputeShader,
          Access::eShaderRead | Access::eShaderWrite);
}

}  // namespace

Renderer::Renderer(const Device& device, const raymeld::SharedModel& model, vk::Extent2D size,
                   const RendererOptions& options)
    : small_(small_size_of(size, model.info().scale)),
      full_(small_.width * model.info().scale, small_.height * model.info().scale),
      fusion_(device.raymeld(), model, fusion_desc(small_, model.info().scale, options)),
      buffers_(make_buffers(device, small_, full_)),
      shown_(make_image(device, size)),
      passes_(device, buffers_, shown_) {
  const uint32_t scale = model.info().scale;
  const std::vector<std::string> layers = fusion_.layers();
  if (layers != std::vector<std::string>{"color", "albedo", "normal", "diffuse", "specular"})
    throw std::runtime_error("the model " + std::string(model.info().name) +
                             " reads other layers than this program renders, which are color, albedo, "
                             "normal, diffuse and specular");
  if (const raymeld_fusion_info info = fusion_.info();
      info.tile_height != small_.height || info.tile_width != small_.width)
    throw std::runtime_error("the device has no room for a frame in one tile");
  constants_.width = full_.width;
  constants_.height = full_.height;
  constants_.scale = scale;
  constants_.lrhs_samples = lrhs_samples_of(options, scale);
  constants_.hrls_samples = options.hrls_samples;
  constants_.has_motion = options.history;
}

void Renderer::update_constants(vk::CommandBuffer commands, const Frame& frame) {
  const bool still = !first_ && std::memcmp(&constants_.camera, &frame.camera, sizeof(Camera)) == 0 &&
                     constants_.scene_s == frame.scene_s;
  constants_.last_camera = first_ ? frame.camera : constants_.camera;
  constants_.last_scene_s = first_ ? frame.scene_s : constants_.scene_s;
  constants_.camera = frame.camera;
  constants_.scene_s = frame.scene_s;
  ++constants_.frame;
  accumulated_ = frame.view == kViewConverged && still && !frame.restarts ? accumulated_ : 0;
  constants_.accumulated_frames = accumulated_;
  constants_.text_rows = frame.text_rows;
  if (frame.text_rows) std::memcpy(constants_.text, frame.text, sizeof(frame.text[0]) * frame.text_rows);
  accumulated_ += frame.view == kViewConverged;
  commands.updateBuffer<Constants>(*buffers_[kConstants].buffer, 0, constants_);
}

void Renderer::record(vk::CommandBuffer commands, const Frame& frame, vk::QueryPool queries) {
  const auto stamp = [&](uint32_t index) { commands.writeTimestamp(Stage::eComputeShader, queries, index); };
  // Earlier frames may still use the same buffers.
  barrier(commands, Stage::eComputeShader | Stage::eTransfer, Access::eShaderWrite | Access::eTransferWrite,
          Stage::eTransfer | Stage::eComputeShader,
          Access::eTransferWrite | Access::eShaderRead | Access::eShaderWrite);
  update_constants(commands, frame);
  barrier(commands, Stage::eTransfer, Access::eTransferWrite, Stage::eComputeShader, Access::eShaderRead);
  first_ = false;

  const bool fuses = frame.view != kViewConverged;
  commands.resetQueryPool(queries, 0, kStamps);
  stamp(0);
  if (fuses) passes_.record(commands, Pass::kTraceLrhs, small_);
  stamp(1);
  passes_.record(commands, Pass::kTraceHrls, full_);
  barrier(commands);
  if (!fuses) {
    passes_.record(commands, Pass::kAccumulate, full_);
    barrier(commands);
  }
  stamp(2);
  if (fuses) {
    raymeld_image images[4];
    images[0].buffer = *buffers_[kLrhs].buffer;
    images[1].buffer = *buffers_[kHrls].buffer;
    images[2].buffer = *buffers_[kFused].buffer;
    images[3].buffer = *buffers_[kMotion].buffer;
    raymeld_frame fused;
    fused.lrhs = &images[0];
    fused.hrls = &images[1];
    fused.fused = &images[2];
    if (constants_.has_motion) {
      fused.motion = &images[3];
      if (!is_joined_) fusion_.reset_history();
    }
    fusion_.record(commands, fused);
    barrier(commands);
  }
  is_joined_ = fuses;
  stamp(3);
  record_view(commands, frame.view);
  stamp(4);
  record_end(commands);
}

void Renderer::record_end(vk::CommandBuffer commands) const {
  commands.pipelineBarrier(Stage::eComputeShader, Stage::eTransfer, {}, {}, {},
                           image_barrier(*shown_.image, Access::eShaderWrite, Access::eTransferRead,
                                         vk::ImageLayout::eGeneral, vk::ImageLayout::eTransferSrcOptimal));
}

void Renderer::record_again(vk::CommandBuffer commands, uint32_t view, vk::QueryPool queries) const {
  commands.resetQueryPool(queries, 0, kStamps);
  for (uint32_t i = 0; i < kStamps; ++i) commands.writeTimestamp(Stage::eComputeShader, queries, i);
  record_view(commands, view);
  record_end(commands);
}

void Renderer::record_view(vk::CommandBuffer commands, uint32_t view) const {
  // The old content of the image is discarded.
  commands.pipelineBarrier(
      Stage::eTransfer | Stage::eComputeShader, Stage::eComputeShader, {},
      vk::MemoryBarrier{.srcAccessMask = Access::eShaderWrite, .dstAccessMask = Access::eShaderRead}, {},
      image_barrier(*shown_.image, {}, Access::eShaderWrite, vk::ImageLayout::eUndefined,
                    vk::ImageLayout::eGeneral));
  passes_.record(commands, Pass::kShow, shown_.size, view);
  if (constants_.text_rows == 0) return;
  barrier(commands);
  passes_.record(commands, Pass::kOverlay, shown_.size);
}

}  // namespace postpass
