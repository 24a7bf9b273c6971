#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "engine/device.h"

namespace raymeld {

// Holds the SPIR-V of one shader, for tensors stored in 32 and in 16 bits; the latter may have another form
// for devices with DeviceInfo::half_dots.
struct Shader {
  const char* name;
  std::span<const uint32_t> f32;
  std::span<const uint32_t> f16;
  std::span<const uint32_t> f16_dots = {};
};

// Describes a compute pipeline: a shader with its specialization constants (ids 0, 1, 2, ...). `descriptors`
// are in the order of the bindings; the push constants take push_bytes.
struct KernelRecipe {
  const char* name;
  std::span<const uint32_t> spirv;
  std::vector<uint32_t> constants;
  std::vector<VkDescriptorType> descriptors;
  uint32_t push_bytes = 0;
  VkPipelineShaderStageCreateFlags stage_flags = 0;
  uint32_t subgroup_size = 0;  // the size to require, or 0
  uint32_t unroll = 1;         // see loops.glsl

  bool operator<(const KernelRecipe& other) const {
    const uint32_t *own = spirv.data(), *others = other.spirv.data();
    return std::tie(own, constants, descriptors, push_bytes, stage_flags, subgroup_size, unroll) <
           std::tie(others, other.constants, other.descriptors, other.push_bytes, other.stage_flags,
                    other.subgroup_size, other.unroll);
  }
};

// Holds a compute pipeline, whose specialization constant kIdLanesId is the device's id_lanes.
class Kernel {
 public:
  static constexpr uint32_t kIdLanesId = 29;  // ids.glsl
  static constexpr uint32_t kUnrollId = 30;   // loops.glsl
  // Throws Error.
  Kernel(const Device& device, VkPipelineCache cache, const KernelRecipe& recipe);
  ~Kernel();
  Kernel(const Kernel&) = delete;
  Kernel& operator=(const Kernel&) = delete;

  VkPipeline pipeline() const { return pipeline_; }
  VkPipelineLayout layout() const { return layout_; }
  VkDescriptorSetLayout set_layout() const { return set_layout_; }

 private:
  explicit Kernel(const Device& device) : device_(device) {}
  void create_layout(const KernelRecipe& recipe);

  const Device& device_;
  VkDescriptorSetLayout set_layout_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkPipeline pipeline_ = VK_NULL_HANDLE;
};

}  // namespace raymeld
