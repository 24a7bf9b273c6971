// Holds the demo's own compute passes: one descriptor set, in which each binding of params.h is a whole
// buffer or the shown image, and a pipeline for each pass.
#pragma once

#include <array>
#include <span>

#include "params.h"
#include "resources.h"

namespace postpass {

enum class Pass { kTraceLrhs, kTraceHrls, kAccumulate, kShow, kOverlay };
constexpr uint32_t kPasses = 5;

class Passes {
 public:
  // `buffers` holds those of the bindings 0 to kShown - 1.
  Passes(const Device& device, std::span<const Buffer, kShown> buffers, const Image& shown);

  // Records an invocation for each pixel, without barriers. kShow shows `view`.
  void record(vk::CommandBuffer commands, Pass pass, vk::Extent2D pixels, uint32_t view = 0) const;

 private:
  vk::UniqueDescriptorSetLayout set_layout_;
  vk::UniquePipelineLayout layout_;
  vk::UniqueDescriptorPool pool_;
  vk::DescriptorSet set_;
  std::array<vk::UniquePipeline, kPasses> pipelines_;
};

}  // namespace postpass
