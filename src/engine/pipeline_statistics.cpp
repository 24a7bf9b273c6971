#include "engine/pipeline_statistics.h"

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <span>

#include "engine/instance.h"

namespace raymeld {
namespace {

double value_of(const VkPipelineExecutableStatisticKHR& statistic) {
  switch (statistic.format) {
    case VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_BOOL32_KHR:
      return statistic.value.b32;
    case VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_INT64_KHR:
      return static_cast<double>(statistic.value.i64);
    case VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_UINT64_KHR:
      return static_cast<double>(statistic.value.u64);
    default:
      return statistic.value.f64;
  }
}

std::vector<PipelineStatistic> statistics_of(const Device& device, VkPipeline pipeline, uint32_t index) {
  const VulkanFunctions& vk = device.vk();
  auto which = vk_struct<VkPipelineExecutableInfoKHR>(VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_INFO_KHR);
  which.pipeline = pipeline;
  which.executableIndex = index;
  const char* what = "reading a pipeline's statistics";
  uint32_t count = 0;
  check(vk.GetPipelineExecutableStatisticsKHR(device.handle(), &which, &count, nullptr), what);
  std::vector<VkPipelineExecutableStatisticKHR> listed(
      count,
      vk_struct<VkPipelineExecutableStatisticKHR>(VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_STATISTIC_KHR));
  check(vk.GetPipelineExecutableStatisticsKHR(device.handle(), &which, &count, listed.data()), what);
  std::vector<PipelineStatistic> statistics;
  for (const auto& statistic : listed) statistics.push_back({statistic.name, value_of(statistic)});
  return statistics;
}

}  // namespace

bool tells_pipeline_statistics(const VulkanFunctions& vk, VkPhysicalDevice physical_device) {
  if (!has_extension(vk, physical_device, VK_KHR_PIPELINE_EXECUTABLE_PROPERTIES_EXTENSION_NAME)) return false;
  auto statistics = vk_struct<VkPhysicalDevicePipelineExecutablePropertiesFeaturesKHR>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PIPELINE_EXECUTABLE_PROPERTIES_FEATURES_KHR);
  auto features =
      vk_struct<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &statistics);
  vk.GetPhysicalDeviceFeatures2(physical_device, &features);
  return statistics.pipelineExecutableInfo;
}

std::vector<PipelineExecutable> pipeline_executables(const Device& device, VkPipeline pipeline) {
  if (!device.tells_statistics()) return {};
  const VulkanFunctions& vk = device.vk();
  auto which = vk_struct<VkPipelineInfoKHR>(VK_STRUCTURE_TYPE_PIPELINE_INFO_KHR);
  which.pipeline = pipeline;
  const char* what = "listing a pipeline's executables";
  uint32_t count = 0;
  check(vk.GetPipelineExecutablePropertiesKHR(device.handle(), &which, &count, nullptr), what);
  std::vector<VkPipelineExecutablePropertiesKHR> listed(
      count,
      vk_struct<VkPipelineExecutablePropertiesKHR>(VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_PROPERTIES_KHR));
  check(vk.GetPipelineExecutablePropertiesKHR(device.handle(), &which, &count, listed.data()), what);
  std::vector<PipelineExecutable> executables;
  for (uint32_t i = 0; i < count; ++i)
    executables.push_back({listed[i].name, listed[i].subgroupSize, statistics_of(device, pipeline, i)});
  return executables;
}

uint32_t workgroup_invocations(const KernelRecipe& recipe) {
  // The numbers are those of the SPIR-V specification.
  constexpr uint32_t kHeaderWords = 5, kExecutionMode = 16, kConstant = 43, kSpecConstant = 50,
                     kSpecConstantComposite = 51, kDecorate = 71;
  constexpr uint32_t kLocalSize = 17, kSpecId = 1, kBuiltIn = 11, kWorkgroupSize = 25;
  std::map<uint32_t, uint32_t> spec_ids, constants;  // keys are the ids of constants
  uint32_t size = 0;                                 // names the constant that is the workgroup's size
  std::vector<uint32_t> sides;
  const std::span<const uint32_t> words = recipe.spirv;
  for (size_t i = kHeaderWords; i < words.size() && words[i] >> 16 > 0; i += words[i] >> 16) {
    const auto operands = words.subspan(i + 1, std::min<size_t>((words[i] >> 16) - 1, words.size() - i - 1));
    const uint32_t operation = words[i] & 0xffff;
    if (operation == kExecutionMode && operands[1] == kLocalSize) {
      sides.assign(operands.begin() + 2, operands.end());
    } else if (operation == kDecorate && operands[1] == kSpecId) {
      spec_ids[operands[0]] = operands[2];
    } else if (operation == kDecorate && operands[1] == kBuiltIn && operands[2] == kWorkgroupSize) {
      size = operands[0];
    } else if (operation == kConstant || operation == kSpecConstant) {
      const auto spec_id = spec_ids.find(operands[1]);
      const bool is_set = spec_id != spec_ids.end() && spec_id->second < recipe.constants.size();
      constants[operands[1]] = is_set ? recipe.constants[spec_id->second] : operands[2];
    } else if (operation == kSpecConstantComposite && operands[1] == size) {
      sides.clear();
      for (const uint32_t side : operands.subspan(2)) sides.push_back(constants[side]);
    }
  }
  return std::accumulate(sides.begin(), sides.end(), 1u, std::multiplies<>());
}

}  // namespace raymeld
