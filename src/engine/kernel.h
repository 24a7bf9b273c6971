#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "engine/device.h"

namespace raymeld {

// SPIR-V of one shader, for tensors stored in 32 and in 16 bits.
struct Shader {
  const char* name;
  std::span<const uint32_t> f32;
  std::span<const uint32_t> f16;
};

// A compute pipeline: a shader with its specialization constants (ids 0, 1, 2, ...; kIdLanesId the
// device's id_lanes; kBlocksId and the next what passes of a sparse graph know of its blocks). `descriptors`
// are by binding; push constants fill push_bytes. Move-only.
class Kernel {
 public:
  static constexpr uint32_t kIdLanesId = 29;  // invocation.glsl
  static constexpr uint32_t kBlocksId = 30;   // place.glsl, left_out.glsl
  Kernel(const Device& device, VkPipelineCache cache, std::span<const uint32_t> spirv,
         const std::string& name, std::span<const uint32_t> constants, std::array<uint32_t, 2> blocks,
         std::span<const VkDescriptorType> descriptors, uint32_t push_bytes,
         VkPipelineShaderStageCreateFlags stage_flags = 0);
  ~Kernel();
  Kernel(Kernel&& other) noexcept { *this = std::move(other); }
  Kernel& operator=(Kernel&& other) noexcept;

  VkPipeline pipeline() const { return pipeline_; }
  VkPipelineLayout layout() const { return layout_; }
  VkDescriptorSetLayout set_layout() const { return set_layout_; }

 private:
  Kernel() = default;
  void create_layout(const std::string& name, std::span<const VkDescriptorType> descriptors,
                     uint32_t push_bytes);

  const Device* device_ = nullptr;
  VkDescriptorSetLayout set_layout_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkPipeline pipeline_ = VK_NULL_HANDLE;
};

}  // namespace raymeld
