#include "engine/kernel.h"

#include <vector>

#include "engine/float_controls.h"
#include "error.h"

namespace raymeld {

Kernel::Kernel(const Device& device, VkPipelineCache cache, const KernelRecipe& recipe) : Kernel(device) {
  create_layout(recipe);
  const std::string name = recipe.name;
  const VulkanFunctions& vk = device.vk();
  auto code = vk_struct<VkShaderModuleCreateInfo>(VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO);
  const std::vector<uint32_t> spirv = with_float_controls(recipe.spirv, device.info().float_controls);
  code.codeSize = spirv.size() * sizeof(uint32_t);
  code.pCode = spirv.data();
  VkShaderModule module = VK_NULL_HANDLE;
  check(vk.CreateShaderModule(device.handle(), &code, device.allocator(), &module), "loading shader " + name);

  std::vector<VkSpecializationMapEntry> entries;
  std::vector<uint32_t> values = recipe.constants;
  for (uint32_t id = 0; id < values.size(); ++id) entries.push_back({id, id * 4, 4});
  const auto specialize = [&](uint32_t id, uint32_t value) {
    entries.push_back({id, static_cast<uint32_t>(values.size()) * 4, 4});
    values.push_back(value);
  };
  specialize(kIdLanesId, device.info().id_lanes);
  specialize(kUnrollId, recipe.unroll);
  const VkSpecializationInfo specialization{static_cast<uint32_t>(entries.size()), entries.data(),
                                            values.size() * sizeof(uint32_t), values.data()};
  auto info = vk_struct<VkComputePipelineCreateInfo>(VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO);
  info.flags = VK_PIPELINE_CREATE_DISPATCH_BASE_BIT;
  if (device.tells_statistics()) info.flags |= VK_PIPELINE_CREATE_CAPTURE_STATISTICS_BIT_KHR;
  auto size = vk_struct<VkPipelineShaderStageRequiredSubgroupSizeCreateInfoEXT>(
      VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_REQUIRED_SUBGROUP_SIZE_CREATE_INFO_EXT);
  size.requiredSubgroupSize = recipe.subgroup_size;
  info.stage = {VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                recipe.subgroup_size ? &size : nullptr,
                recipe.stage_flags,
                VK_SHADER_STAGE_COMPUTE_BIT,
                module,
                "main",
                &specialization};
  info.layout = layout_;
  const VkResult result =
      vk.CreateComputePipelines(device.handle(), cache, 1, &info, device.allocator(), &pipeline_);
  vk.DestroyShaderModule(device.handle(), module, device.allocator());
  check(result, "compiling shader " + name);
  device.name(VK_OBJECT_TYPE_PIPELINE, pipeline_, name);
}

Kernel::~Kernel() {
  const VulkanFunctions& vk = device_.vk();
  vk.DestroyPipeline(device_.handle(), pipeline_, device_.allocator());
  vk.DestroyPipelineLayout(device_.handle(), layout_, device_.allocator());
  vk.DestroyDescriptorSetLayout(device_.handle(), set_layout_, device_.allocator());
}

void Kernel::create_layout(const KernelRecipe& recipe) {
  const VulkanFunctions& vk = device_.vk();
  std::vector<VkDescriptorSetLayoutBinding> bindings;
  for (uint32_t i = 0; i < recipe.descriptors.size(); ++i)
    bindings.push_back({i, recipe.descriptors[i], 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
  auto set = vk_struct<VkDescriptorSetLayoutCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO);
  set.bindingCount = static_cast<uint32_t>(bindings.size());
  set.pBindings = bindings.data();
  check(vk.CreateDescriptorSetLayout(device_.handle(), &set, device_.allocator(), &set_layout_),
        std::string("describing ") + recipe.name);

  const VkPushConstantRange push{VK_SHADER_STAGE_COMPUTE_BIT, 0, recipe.push_bytes};
  auto layout = vk_struct<VkPipelineLayoutCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO);
  layout.setLayoutCount = 1;
  layout.pSetLayouts = &set_layout_;
  layout.pushConstantRangeCount = recipe.push_bytes > 0;
  layout.pPushConstantRanges = &push;
  check(vk.CreatePipelineLayout(device_.handle(), &layout, device_.allocator(), &layout_),
        std::string("describing ") + recipe.name);
}

}  // namespace raymeld
