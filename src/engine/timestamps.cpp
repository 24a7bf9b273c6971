#include "engine/timestamps.h"

namespace raymeld {

Timestamps::Timestamps(const Device& device, uint32_t passes) : device_(device), passes_(passes) {
  auto info = vk_struct<VkQueryPoolCreateInfo>(VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO);
  info.queryType = VK_QUERY_TYPE_TIMESTAMP;
  info.queryCount = passes + 1;
  check(device.vk().CreateQueryPool(device.handle(), &info, device.allocator(), &pool_),
        "creating a query pool");
}

Timestamps::~Timestamps() { device_.vk().DestroyQueryPool(device_.handle(), pool_, device_.allocator()); }

void Timestamps::start(VkCommandBuffer commands) const {
  device_.vk().CmdResetQueryPool(commands, pool_, 0, passes_ + 1);
  device_.vk().CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool_, 0);
}

void Timestamps::mark(VkCommandBuffer commands, uint32_t index) const {
  device_.vk().CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool_, index + 1);
}

std::optional<std::vector<double>> Timestamps::pass_ms() const {
  std::vector<uint64_t> ticks(passes_ + 1);
  const VkResult result = device_.vk().GetQueryPoolResults(device_.handle(), pool_, 0, passes_ + 1,
                                                           ticks.size() * sizeof(uint64_t), ticks.data(),
                                                           sizeof(uint64_t), VK_QUERY_RESULT_64_BIT);
  if (result == VK_NOT_READY) return {};
  check(result, "reading timestamps of " + device_.info().name);
  std::vector<double> times;
  for (uint32_t i = 0; i < passes_; ++i) times.push_back(device_.info().ms_between(ticks[i], ticks[i + 1]));
  return times;
}

}  // namespace raymeld
