#include "conform/layer_run.h"

#include "engine/commands.h"
#include "reference/samples.h"

namespace raymeld::conform {

using reference::Planes;
using reference::Precision;

Storage storage_of(Precision precision) {
  return precision == Precision::kFp16 ? Storage::kFloat16 : Storage::kFloat32;
}

std::string name_of(Precision precision) { return precision == Precision::kFp16 ? "fp16" : "fp32"; }

void run_passes(const Device& device, const Program& program, const Graph& graph) {
  Commands pool(device);
  const VkCommandBuffer commands = pool.begin("layers");
  program.record(commands, 0, 0, graph.passes().size());
  auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  device.vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT,
                                 0, 1, &barrier, 0, nullptr, 0, nullptr);
  pool.end(commands);
  device.submit_and_wait(commands);
}

LayerRun::LayerRun(const Target& target, Precision precision, bool addressed)
    : target_(target), graph_(storage_of(precision), addressed, true) {}

Tensor LayerRun::input(const std::string& name, const Planes& values) {
  const Tensor result = graph_.input(name, {uint32_t(values.h), uint32_t(values.w), uint32_t(values.c)});
  inputs_.emplace_back(result, reference::floats(values));
  return result;
}

Tensor LayerRun::tensor(const std::string& name, int c, int h, int w) {
  return graph_.tensor(name, {uint32_t(h), uint32_t(w), uint32_t(c)});
}

ConvWeights LayerRun::weights(const reference::Conv& conv) {
  const auto& weight = weights_.emplace_back(conv.weight.begin(), conv.weight.end());
  const auto& bias = weights_.emplace_back(conv.bias.begin(), conv.bias.end());
  return {weight, bias};
}

void LayerRun::run(const FrameBindings& frame, float exposure, const Place& place) {
  graph_.plan();
  program_ = std::make_unique<Program>(target_.device, graph_, target_.cache, 1);
  for (const auto& [tensor, values] : inputs_) program_->write(tensor, values);
  program_->bind(0, frame);
  program_->set_exposure(0, exposure);
  program_->set_place(0, place);
  run_passes(target_.device, *program_, graph_);
}

Planes LayerRun::read(const Tensor& tensor) const {
  return reference::planes(int(tensor.shape.channels), int(tensor.shape.height), int(tensor.shape.width),
                           program_->read(tensor));
}

}  // namespace raymeld::conform
