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
  VkBool32 cooperativeMatrix = VK_TRUE, cooperativeMatrixRobustBufferAccess = VK_FALSE;
};

// Those that make raymeld faster, as far as the device has them; adds what they take to `extensions`.
uint32_t choose_features(vk::Instance instance, vk::PhysicalDevice device,
                         std::vector<const char*>& extensions) {
  constexpr uint32_t kWanted = RAYMELD_FEATURE_STORAGE_16BIT | RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS |
                               RAYMELD_FEATURE_COOPERATIVE_MATRIX;
  uint32_t bits = 0;
  for (const raymeld_feature& feature : raymeld::list_features(vkGetInstanceProcAddr, instance, device)) {
    if (!feature.supported || !(feature.bit & kWanted)) continue;
    bits |= feature.bit;
    extensions.insert(extensions.end(), feature.extensions, feature.extensions + feature.extension_count);
  }
  return bits;
}

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

  std::vector<const char*> extensions;
  const uint32_t features = choose_features(instance.get(), physical_, extensions);
  if (surface) extensions.push_back(VK_KHR_SWAPCHAIN_EXTENSION_NAME);
  vk::PhysicalDeviceBufferDeviceAddressFeatures addresses{.bufferDeviceAddress = true};
  vk::PhysicalDevice16BitStorageFeatures half{.storageBuffer16BitAccess = true};
  vk::PhysicalDeviceFeatures2 enabled;
  const auto enable = [&](auto& structure) { structure.pNext = std::exchange(enabled.pNext, &structure); };
  if (features & RAYMELD_FEATURE_STORAGE_16BIT) enable(half);
  if (features & RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS) {
    enable(addresses);
    enabled.features.shaderInt64 = true;
  }
  CooperativeMatrixFeatures matrices;
  vk::PhysicalDeviceVulkanMemoryModelFeatures model{.vulkanMemoryModel = true,
                                                    .vulkanMemoryModelDeviceScope = true};
  vk::PhysicalDeviceShaderFloat16Int8Features float16{.shaderFloat16 = true};
  vk::PhysicalDeviceSubgroupSizeControlFeatures subgroups{.computeFullSubgroups = true};
  if (features & RAYMELD_FEATURE_COOPERATIVE_MATRIX) {
    enable(matrices);
    enable(model);
    enable(float16);
    enable(subgroups);
  }
  const float priority = 1;
  const vk::DeviceQueueCreateInfo queue{
      .queueFamilyIndex = queue_family_, .queueCount = 1, .pQueuePriorities = &priority};
  device_ = physical_.createDeviceUnique({.pNext = &enabled,
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
  desc.enabled_features = features;
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
