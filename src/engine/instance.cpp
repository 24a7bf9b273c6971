#include "engine/instance.h"

#include <algorithm>
#include <cctype>
#include <cstring>

#include "engine/half_dots.h"
#include "error.h"

namespace raymeld {
namespace {

constexpr const char* kValidationLayer = "VK_LAYER_KHRONOS_validation";

bool has_instance_extension(const VulkanFunctions& vk, const char* name) {
  uint32_t count = 0;
  const char* what = "listing the extensions of the Vulkan loader";
  check(vk.EnumerateInstanceExtensionProperties(nullptr, &count, nullptr), what);
  std::vector<VkExtensionProperties> extensions(count);
  check(vk.EnumerateInstanceExtensionProperties(nullptr, &count, extensions.data()), what);
  return std::any_of(extensions.begin(), extensions.end(),
                     [&](const auto& e) { return std::strcmp(e.extensionName, name) == 0; });
}

void require_validation_layer(const VulkanFunctions& vk) {
  uint32_t count = 0;
  check(vk.EnumerateInstanceLayerProperties(&count, nullptr), "listing Vulkan layers");
  std::vector<VkLayerProperties> layers(count);
  check(vk.EnumerateInstanceLayerProperties(&count, layers.data()), "listing Vulkan layers");
  for (const auto& layer : layers) {
    if (std::strcmp(layer.layerName, kValidationLayer) == 0) return;
  }
  throw Error("{} is not installed; Debian's vulkan-validationlayers has it", kValidationLayer);
}

std::string type_name(VkPhysicalDeviceType type) {
  switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
      return "discrete GPU";
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
      return "integrated GPU";
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
      return "virtual GPU";
    case VK_PHYSICAL_DEVICE_TYPE_CPU:
      return "CPU";
    default:
      return "other";
  }
}

std::string uuid_text(const uint8_t* bytes) {
  std::string text;
  for (unsigned i = 0; i < VK_UUID_SIZE; ++i) {
    if (i == 4 || i == 6 || i == 8 || i == 10) text += '-';
    text += fmt::format("{:02x}", bytes[i]);
  }
  return text;
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

// Returns the bytes of the largest device-local heap: its budget where VK_EXT_memory_budget tells it, else
// its size.
uint64_t device_memory_bytes(const VulkanFunctions& vk, VkPhysicalDevice device) {
  auto budget = vk_struct<VkPhysicalDeviceMemoryBudgetPropertiesEXT>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT);
  const bool has_budget = has_extension(vk, device, VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
  auto memory = vk_struct<VkPhysicalDeviceMemoryProperties2>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2, has_budget ? &budget : nullptr);
  vk.GetPhysicalDeviceMemoryProperties2(device, &memory);
  uint64_t largest = 0;
  for (uint32_t i = 0; i < memory.memoryProperties.memoryHeapCount; ++i) {
    const VkMemoryHeap& heap = memory.memoryProperties.memoryHeaps[i];
    if (!(heap.flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT)) continue;
    const uint64_t size = has_budget ? std::min(heap.size, budget.heapBudget[i]) : heap.size;
    largest = std::max<uint64_t>(largest, size);
  }
  return largest;
}

void find_features(const VulkanFunctions& vk, VkPhysicalDevice device, DeviceInfo& info) {
  auto storage = vk_struct<VkPhysicalDevice16BitStorageFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES);
  auto float16 = vk_struct<VkPhysicalDeviceShaderFloat16Int8Features>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_FLOAT16_INT8_FEATURES);
  auto address = vk_struct<VkPhysicalDeviceBufferDeviceAddressFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES);
  auto timeline = vk_struct<VkPhysicalDeviceTimelineSemaphoreFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES);
  auto features =
      vk_struct<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &storage);
  if (has_extension(vk, device, VK_KHR_SHADER_FLOAT16_INT8_EXTENSION_NAME)) {
    float16.pNext = features.pNext;
    features.pNext = &float16;
  }
  if (has_extension(vk, device, VK_KHR_BUFFER_DEVICE_ADDRESS_EXTENSION_NAME)) {
    address.pNext = features.pNext;
    features.pNext = &address;
  }
  if (has_extension(vk, device, VK_KHR_TIMELINE_SEMAPHORE_EXTENSION_NAME)) {
    timeline.pNext = features.pNext;
    features.pNext = &timeline;
  }
  auto dots = vk_struct<VkPhysicalDeviceShaderMixedFloatDotProductFeaturesVALVE>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_MIXED_FLOAT_DOT_PRODUCT_FEATURES_VALVE);
  if (has_extension(vk, device, VK_VALVE_SHADER_MIXED_FLOAT_DOT_PRODUCT_EXTENSION_NAME)) {
    dots.pNext = features.pNext;
    features.pNext = &dots;
  }
  vk.GetPhysicalDeviceFeatures2(device, &features);
  info.storage_16bit = storage.storageBuffer16BitAccess;
  info.float16_arithmetic = float16.shaderFloat16;
  info.buffer_device_address = address.bufferDeviceAddress && features.features.shaderInt64;
  info.image_writes = features.features.shaderStorageImageWriteWithoutFormat;
  info.timeline_semaphore = timeline.timelineSemaphore;
  info.external_memory_fd = has_extension(vk, device, VK_KHR_EXTERNAL_MEMORY_FD_EXTENSION_NAME);
  info.dma_buf =
      info.external_memory_fd && has_extension(vk, device, VK_EXT_EXTERNAL_MEMORY_DMA_BUF_EXTENSION_NAME);
  info.cooperative_matrix = find_cooperative_matrix(vk, device);
  info.half_dots = dots.shaderMixedFloatDotProductFloat16AccFloat32 && info.float16_arithmetic;
  info.float_controls = find_float_controls(vk, device);
  info.is_portable_subset = has_extension(vk, device, kPortabilitySubset);
}

}  // namespace

VkInstance make_instance(VulkanFunctions& vk, Validation validation) {
  uint32_t version = 0;
  check(vk.EnumerateInstanceVersion(&version), "asking the Vulkan loader for its version");
  if (version < VK_API_VERSION_1_1) throw Error("the Vulkan loader is older than 1.1");

  std::vector<const char*> extensions;
  std::vector<const char*> layers;
  if (has_instance_extension(vk, VK_EXT_DEBUG_UTILS_EXTENSION_NAME)) {
    extensions.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
  }
  const VkValidationFeatureEnableEXT enables[] = {
      VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT,
      VK_VALIDATION_FEATURE_ENABLE_GPU_ASSISTED_EXT,
  };
  auto features = vk_struct<VkValidationFeaturesEXT>(VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT);
  features.enabledValidationFeatureCount = validation == Validation::kGpuAssisted ? 2 : 1;
  features.pEnabledValidationFeatures = enables;
  if (validation != Validation::kNone) {
    require_validation_layer(vk);
    layers.push_back(kValidationLayer);
    extensions.push_back(VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME);
  }

  // Lists drivers that put Vulkan on top of another interface as well, such as MoltenVK.
  const bool portable = has_instance_extension(vk, VK_KHR_PORTABILITY_ENUMERATION_EXTENSION_NAME);
  if (portable) extensions.push_back(VK_KHR_PORTABILITY_ENUMERATION_EXTENSION_NAME);

  auto application = vk_struct<VkApplicationInfo>(VK_STRUCTURE_TYPE_APPLICATION_INFO);
  application.pApplicationName = "raymeld";
  application.apiVersion = VK_API_VERSION_1_1;
  auto info = vk_struct<VkInstanceCreateInfo>(VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO);
  info.pNext = validation == Validation::kNone ? nullptr : &features;
  if (portable) info.flags = VK_INSTANCE_CREATE_ENUMERATE_PORTABILITY_BIT_KHR;
  info.pApplicationInfo = &application;
  info.enabledLayerCount = static_cast<uint32_t>(layers.size());
  info.ppEnabledLayerNames = layers.data();
  info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  VkInstance instance = VK_NULL_HANDLE;
  const VkResult result = vk.CreateInstance(&info, nullptr, &instance);
  if (result == VK_ERROR_INCOMPATIBLE_DRIVER) {
    throw Error("no Vulkan device: no driver is installed (Debian's mesa-vulkan-drivers has one for CPUs)");
  }
  check(result, "creating the Vulkan instance");
  vk.load_instance(instance);
  return instance;
}

std::vector<VkPhysicalDevice> physical_devices(const VulkanFunctions& vk, VkInstance instance) {
  uint32_t count = 0;
  check(vk.EnumeratePhysicalDevices(instance, &count, nullptr), "listing Vulkan devices");
  std::vector<VkPhysicalDevice> devices(count);
  check(vk.EnumeratePhysicalDevices(instance, &count, devices.data()), "listing Vulkan devices");
  std::erase_if(devices, [&](VkPhysicalDevice device) {
    VkPhysicalDeviceProperties properties;
    vk.GetPhysicalDeviceProperties(device, &properties);
    return properties.apiVersion < VK_API_VERSION_1_1;
  });
  if (devices.empty()) {
    throw Error("no Vulkan 1.1 device: install a driver (Debian's mesa-vulkan-drivers has one for CPUs)");
  }
  return devices;
}

bool has_extension(const VulkanFunctions& vk, VkPhysicalDevice device, const char* name) {
  uint32_t count = 0;
  VkPhysicalDeviceProperties properties;
  vk.GetPhysicalDeviceProperties(device, &properties);
  const std::string what = fmt::format("listing the extensions of Vulkan device {}", properties.deviceName);
  check(vk.EnumerateDeviceExtensionProperties(device, nullptr, &count, nullptr), what);
  std::vector<VkExtensionProperties> extensions(count);
  check(vk.EnumerateDeviceExtensionProperties(device, nullptr, &count, extensions.data()), what);
  return std::any_of(extensions.begin(), extensions.end(),
                     [&](const auto& e) { return std::strcmp(e.extensionName, name) == 0; });
}

DeviceInfo device_info(const VulkanFunctions& vk, VkPhysicalDevice device, uint32_t index) {
  auto driver =
      vk_struct<VkPhysicalDeviceDriverProperties>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES);
  auto limits = vk_struct<VkPhysicalDeviceMaintenance3Properties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES);
  auto subgroup = vk_struct<VkPhysicalDeviceSubgroupProperties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES, &limits);
  auto id =
      vk_struct<VkPhysicalDeviceIDProperties>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ID_PROPERTIES, &subgroup);
  auto all = vk_struct<VkPhysicalDeviceProperties2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, &id);
  if (has_extension(vk, device, VK_KHR_DRIVER_PROPERTIES_EXTENSION_NAME)) limits.pNext = &driver;
  vk.GetPhysicalDeviceProperties2(device, &all);
  const VkPhysicalDeviceProperties& properties = all.properties;

  DeviceInfo info;
  info.index = index;
  info.name = properties.deviceName;
  info.type = type_name(properties.deviceType);
  info.is_cpu = properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
  info.uuid = uuid_text(id.deviceUUID);
  info.driver = driver.driverName[0] ? fmt::format("{} {}", driver.driverName, driver.driverInfo)
                                     : fmt::format("version {:#x}", properties.driverVersion);
  info.api_version = properties.apiVersion;
  info.memory_bytes = device_memory_bytes(vk, device);
  info.max_storage_range_bytes = properties.limits.maxStorageBufferRange;
  info.max_allocation_bytes = limits.maxMemoryAllocationSize;
  std::copy_n(properties.limits.maxComputeWorkGroupCount, 3, info.max_groups.begin());
  info.storage_alignment_bytes = static_cast<uint32_t>(properties.limits.minStorageBufferOffsetAlignment);
  info.max_storage_buffers = properties.limits.maxPerStageDescriptorStorageBuffers;
  info.max_push_bytes = properties.limits.maxPushConstantsSize;
  info.subgroup_size = subgroup.subgroupSize;
  constexpr VkSubgroupFeatureFlags kNeeded = VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_SHUFFLE_BIT;
  const bool vectors = driver.driverID == VK_DRIVER_ID_MESA_LLVMPIPE &&
                       (subgroup.supportedStages & VK_SHADER_STAGE_COMPUTE_BIT) &&
                       (subgroup.supportedOperations & kNeeded) == kNeeded;
  info.vector_lanes = vectors ? subgroup.subgroupSize : 0;
  // Mesa 26.2 is faster with this, and Mesa 25.0 is not. Only time depends on what versions between them do.
  info.id_lanes = properties.driverVersion >= VK_MAKE_API_VERSION(0, 26, 0, 0) ? info.vector_lanes : 0;
  info.timestamp_period_ns =
      properties.limits.timestampComputeAndGraphics ? properties.limits.timestampPeriod : 0.0;
  find_features(vk, device, info);
  return info;
}

size_t select_device(const std::vector<DeviceInfo>& devices, const std::string& selector) {
  if (selector.empty()) {
    for (const char* type : {"discrete GPU", "integrated GPU", "virtual GPU", "CPU"}) {
      for (size_t i = 0; i < devices.size(); ++i) {
        if (devices[i].type == type) return i;
      }
    }
    return 0;
  }
  std::string all;
  for (const auto& device : devices)
    all += fmt::format("\n  {}: {} {}", device.index, device.name, device.uuid);
  if (std::all_of(selector.begin(), selector.end(), [](unsigned char c) { return std::isdigit(c); }) &&
      selector.size() < 6) {
    const size_t index = std::stoul(selector);
    if (index < devices.size()) return index;
    throw Error("device {} does not exist; the devices are{}", selector, all);
  }
  std::string wanted = lower(selector);
  std::vector<size_t> matches;
  for (size_t i = 0; i < devices.size(); ++i) {
    if (devices[i].uuid == wanted) return i;
    if (lower(devices[i].name).find(wanted) != std::string::npos) matches.push_back(i);
  }
  if (matches.size() == 1) return matches[0];
  throw Error("device \"{}\" matches {} devices, expected one; the devices are{}", selector, matches.size(),
              all);
}

std::vector<DeviceInfo> list_devices() {
  VulkanFunctions vk = VulkanFunctions::load();
  const VkInstance instance = make_instance(vk, Validation::kNone);
  std::vector<DeviceInfo> infos;
  try {
    for (VkPhysicalDevice device : physical_devices(vk, instance)) {
      infos.push_back(device_info(vk, device, static_cast<uint32_t>(infos.size())));
    }
  } catch (...) {
    vk.DestroyInstance(instance, nullptr);
    throw;
  }
  vk.DestroyInstance(instance, nullptr);
  return infos;
}

}  // namespace raymeld
