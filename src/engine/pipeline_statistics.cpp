#include "engine/pipeline_statistics.h"

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

}  // namespace raymeld
