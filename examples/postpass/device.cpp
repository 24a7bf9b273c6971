#include "device.h"

#include <stdexcept>
#include <utility>
#include <vector>

#include "allocations.h"

namespace postpass {
namespace {

// Blits to a window need a queue for graphics.
int find_queue_family(vk::PhysicalDevice device, vk::SurfaceKHR surface) {
  const auto wanted = vk::QueueFlagBits::eGraphics | vk::QueueFlagBits::eCompute;
  const auto families = device.getQueueFamilyProperties();
  for (uint32_t i = 0; i < families.size(); ++i) {
    if ((families[i].queueFlags & wanted) != wanted || families[i].timestampValidBits == 0) continue;
    if (!surface || device.getSurfaceSupportKHR(i, surface)) return int(i);
  }
  return -1;
}

bool has_swapchains(vk::PhysicalDevice device) {
  for (const auto& extension : device.enumerateDeviceExtensionProperties())
    if (std::string_view(extension.extensionName) == VK_KHR_SWAPCHAIN_EXTENSION_NAME) return true;
  return false;
}

// VK_KHR_cooperative_matrix is newer than the headers of Debian 12.
struct CooperativeMatrixFeatures {
  VkStructureType sType = VkStructureType(1000506000);
  void* pNext = nullptr;
  VkBool32 cooperativeMatrix = VK_FALSE, cooperativeMatrixRobustBufferAccess = VK_FALSE;
};

}  // namespace

Device::Device(const Instance& instance, uint32_t index, vk::SurfaceKHR surface) {
  std::vector<std::pair<vk::PhysicalDevice, uint32_t>> fit;
  for (const vk::PhysicalDevice device : instance.get().enumeratePhysicalDevices()) {
    if (device.getProperties().apiVersion < VK_API_VERSION_1_1) continue;
    const int family = find_queue_family(device, surface);
    if (family >= 0 && (!surface || has_swapchains(device))) fit.emplace_back(device, family);
  }
  if (fit.empty())
    throw std::runtime_error(
        "no device of Vulkan 1.1 with a queue for graphics and compute, with timestamps");
  std::tie(physical_, queue_family_) = fit[index % fit.size()];
  const vk::PhysicalDeviceProperties properties = physical_.getProperties();
  name_ = properties.deviceName.data();
  timestamp_period_ns_ = properties.limits.timestampPeriod;
  timestamp_mask_ = ~0ull >> (64 - physical_.getQueueFamilyProperties()[queue_family_].timestampValidBits);

  // These features make raymeld faster.
  vk::PhysicalDeviceSubgroupSizeControlFeatures subgroups;
  vk::PhysicalDeviceShaderFloat16Int8Features float16{.pNext = &subgroups};
  vk::PhysicalDeviceVulkanMemoryModelFeatures model{.pNext = &float16};
  CooperativeMatrixFeatures matrices{.pNext = &model};
  vk::PhysicalDevice16BitStorageFeatures half{.pNext = &matrices};
  vk::PhysicalDeviceBufferDeviceAddressFeatures addresses{.pNext = &half};
  vk::PhysicalDeviceFeatures2 features{.pNext = &addresses};
  const raymeld_enabled_features enabled =
      raymeld::enable_features(vkGetInstanceProcAddr, instance.get(), physical_, features);
  // A driver without cooperative matrices need not know their structure.
  if (!(enabled.bits & RAYMELD_FEATURE_COOPERATIVE_MATRIX)) half.pNext = nullptr;
  std::vector<const char*> extensions(enabled.extensions, enabled.extensions + enabled.extension_count);
  if (surface) extensions.push_back(VK_KHR_SWAPCHAIN_EXTENSION_NAME);
  const float priority = 1;
  const vk::DeviceQueueCreateInfo queue{
      .queueFamilyIndex = queue_family_, .queueCount = 1, .pQueuePriorities = &priority};
  device_ = physical_.createDeviceUnique({.pNext = &features,
                                          .queueCreateInfoCount = 1,
                                          .pQueueCreateInfos = &queue,
                                          .enabledExtensionCount = uint32_t(extensions.size()),
                                          .ppEnabledExtensionNames = extensions.data()});
  queue_ = device_->getQueue(queue_family_, 0);

  const VkAllocationCallbacks& callbacks = counting_callbacks();
  raymeld_context_desc desc;
  desc.get_instance_proc_addr = vkGetInstanceProcAddr;
  desc.instance = instance.get();
  desc.physical_device = physical_;
  desc.device = *device_;
  desc.queue = queue_;
  desc.queue_family = queue_family_;
  desc.enabled_features = enabled.bits;
  desc.allocation_callbacks = &callbacks;
  context_ = std::make_unique<raymeld::Context>(desc);
}

uint32_t Device::memory_type(uint32_t bits, vk::MemoryPropertyFlags wanted,
                             vk::MemoryPropertyFlags better) const {
  const vk::PhysicalDeviceMemoryProperties memory = physical_.getMemoryProperties();
  for (const vk::MemoryPropertyFlags all : {wanted | better, wanted})
    for (uint32_t i = 0; i < memory.memoryTypeCount; ++i)
      if ((bits & 1u << i) && (memory.memoryTypes[i].propertyFlags & all) == all) return i;
  throw std::runtime_error(name_ + " has no memory that is " + vk::to_string(wanted));
}

}  // namespace postpass
