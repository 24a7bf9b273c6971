// Reads what a driver's compiler tells of a pipeline (VK_KHR_pipeline_executable_properties).
#pragma once

#include <string>
#include <vector>

#include "engine/device.h"
#include "engine/kernel.h"

namespace raymeld {

// Holds one figure under the driver's own name, such as "VGPRs" or "Spilled SGPRs". A flag is 0 or 1.
struct PipelineStatistic {
  std::string name;
  double value = 0;
};

// Holds one program that a pipeline was compiled to.
struct PipelineExecutable {
  std::string name;
  uint32_t subgroup_size = 0;
  std::vector<PipelineStatistic> statistics;
};

// Returns whether a driver can tell anything.
bool tells_pipeline_statistics(const VulkanFunctions& vk, VkPhysicalDevice physical_device);

// Returns the executables of a pipeline; none unless DeviceRequest::pipeline_statistics asked for them and
// the driver has any. Throws Error.
std::vector<PipelineExecutable> pipeline_executables(const Device& device, VkPipeline pipeline);

// Returns the invocations of a kernel's workgroups, which its SPIR-V says, or its specialization constants.
uint32_t workgroup_invocations(const KernelRecipe& recipe);

}  // namespace raymeld
