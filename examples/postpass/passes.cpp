#include "passes.h"

#include <vector>

#include "allocations.h"
#include "shaders.h"

namespace postpass {
namespace {

using enum vk::DescriptorType;

vk::UniquePipeline make_pipeline(vk::Device device, vk::PipelineLayout layout, std::span<const uint32_t> code,
                                 VkBool32 full) {
  const vk::UniqueShaderModule shader = device.createShaderModuleUnique(
      {.codeSize = code.size_bytes(), .pCode = code.data()}, counting_callbacks());
  const vk::SpecializationMapEntry entry{.constantID = 0, .offset = 0, .size = sizeof(full)};
  const vk::SpecializationInfo constants{
      .mapEntryCount = 1, .pMapEntries = &entry, .dataSize = sizeof(full), .pData = &full};
  const vk::ComputePipelineCreateInfo info{.stage = {.stage = vk::ShaderStageFlagBits::eCompute,
                                                     .module = *shader,
                                                     .pName = "main",
                                                     .pSpecializationInfo = &constants},
                                           .layout = layout};
  return device.createComputePipelineUnique(nullptr, info, counting_callbacks()).value;
}

}  // namespace

Passes::Passes(const Device& device, std::span<const Buffer, kShown> buffers, const Image& shown) {
  const vk::Device vk = device.get();
  std::vector<vk::DescriptorSetLayoutBinding> bindings(kBindings);
  for (uint32_t i = 0; i < kBindings; ++i)
    bindings[i] = {.binding = i,
                   .descriptorType = i == kShown ? eStorageImage : eStorageBuffer,
                   .descriptorCount = 1,
                   .stageFlags = vk::ShaderStageFlagBits::eCompute};
  set_layout_ = vk.createDescriptorSetLayoutUnique({.bindingCount = kBindings, .pBindings = bindings.data()},
                                                   counting_callbacks());
  const vk::PushConstantRange push{vk::ShaderStageFlagBits::eCompute, 0, sizeof(uint32_t)};
  layout_ = vk.createPipelineLayoutUnique({.setLayoutCount = 1,
                                           .pSetLayouts = &*set_layout_,
                                           .pushConstantRangeCount = 1,
                                           .pPushConstantRanges = &push},
                                          counting_callbacks());
  const std::array<vk::DescriptorPoolSize, 2> sizes = {{{eStorageBuffer, kShown}, {eStorageImage, 1}}};
  pool_ = vk.createDescriptorPoolUnique(
      {.maxSets = 1, .poolSizeCount = sizes.size(), .pPoolSizes = sizes.data()}, counting_callbacks());
  set_ = vk.allocateDescriptorSets(
               {.descriptorPool = *pool_, .descriptorSetCount = 1, .pSetLayouts = &*set_layout_})
             .front();

  std::vector<vk::DescriptorBufferInfo> infos(kShown);
  const vk::DescriptorImageInfo image{.imageView = *shown.view, .imageLayout = vk::ImageLayout::eGeneral};
  std::vector<vk::WriteDescriptorSet> writes(kBindings);
  for (uint32_t i = 0; i < kBindings; ++i) {
    writes[i] = {
        .dstSet = set_, .dstBinding = i, .descriptorCount = 1, .descriptorType = bindings[i].descriptorType};
    if (i == kShown) {
      writes[i].pImageInfo = &image;
    } else {
      infos[i] = vk::DescriptorBufferInfo{.buffer = *buffers[i].buffer, .offset = 0, .range = VK_WHOLE_SIZE};
      writes[i].pBufferInfo = &infos[i];
    }
  }
  vk.updateDescriptorSets(writes, {});

  const std::array<std::span<const uint32_t>, kPasses> codes = {
      shaders::kTrace, shaders::kTrace, shaders::kAccumulate, shaders::kShow, shaders::kOverlay};
  for (size_t i = 0; i < kPasses; ++i)
    pipelines_[i] = make_pipeline(vk, *layout_, codes[i], Pass(i) == Pass::kTraceHrls);
}

void Passes::record(vk::CommandBuffer commands, Pass pass, vk::Extent2D pixels, uint32_t view) const {
  commands.bindPipeline(vk::PipelineBindPoint::eCompute, *pipelines_[size_t(pass)]);
  commands.bindDescriptorSets(vk::PipelineBindPoint::eCompute, *layout_, 0, set_, {});
  commands.pushConstants(*layout_, vk::ShaderStageFlagBits::eCompute, 0, sizeof(view), &view);
  commands.dispatch((pixels.width + kGroup - 1) / kGroup, (pixels.height + kGroup - 1) / kGroup, 1);
}

}  // namespace postpass
