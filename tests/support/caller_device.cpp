#include "caller_device.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <utility>

#include "engine/half_dots.h"
#include "engine/instance.h"
#include "faults.h"
#include "gpu.h"

namespace raymeld::test {
namespace {

PFN_vkGetInstanceProcAddr real_get_instance_proc_addr = nullptr;
std::atomic<PFN_vkGetDeviceProcAddr> real_get_device_proc_addr = nullptr;

VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL get_device_proc_addr(VkDevice device, const char* name) {
  interpose_device(device);
  return interpose(name, real_get_device_proc_addr.load()(device, name));
}

VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL get_instance_proc_addr(VkInstance instance, const char* name) {
  const PFN_vkVoidFunction real = real_get_instance_proc_addr(instance, name);
  if (std::string_view(name) != "vkGetDeviceProcAddr") return interpose(name, real);
  real_get_device_proc_addr = reinterpret_cast<PFN_vkGetDeviceProcAddr>(real);
  return reinterpret_cast<PFN_vkVoidFunction>(&get_device_proc_addr);
}

VKAPI_ATTR VkBool32 VKAPI_CALL collect(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                       VkDebugUtilsMessageTypeFlagsEXT,
                                       const VkDebugUtilsMessengerCallbackDataEXT* data, void* messages) {
  static_cast<std::vector<std::string>*>(messages)->push_back(data->pMessage);
  return VK_FALSE;
}

VkDebugUtilsMessengerEXT make_messenger(const VulkanFunctions& vk, VkInstance instance,
                                        std::vector<std::string>& messages) {
  auto info =
      vk_struct<VkDebugUtilsMessengerCreateInfoEXT>(VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT);
  info.messageSeverity =
      VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  info.messageType =
      VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
  info.pfnUserCallback = collect;
  info.pUserData = &messages;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
  check(vk.CreateDebugUtilsMessengerEXT(instance, &info, nullptr, &messenger), "creating a messenger");
  return messenger;
}

}  // namespace

CallerDevice::CallerDevice(bool storage_16bit, bool addresses, bool matrices) : vk_(VulkanFunctions::load()) {
  const Validation validation = asked_validation();
  real_get_instance_proc_addr = vk_.GetInstanceProcAddr;
  external_.get_instance_proc_addr = get_instance_proc_addr;
  external_.instance = make_instance(vk_, validation);
  if (validation != Validation::kNone) messenger_ = make_messenger(vk_, external_.instance, messages_);
  external_.physical_device = physical_devices(vk_, external_.instance).front();
  external_.storage_16bit = storage_16bit;
  const DeviceInfo has = device_info(vk_, external_.physical_device, 0);
  external_.buffer_device_address = addresses && has.buffer_device_address;
  external_.image_writes = has.image_writes;
  external_.cooperative_matrix = matrices && has.cooperative_matrix;
  external_.half_dots = has.half_dots;
  external_.float_controls = has.float_controls.any();
  external_.timeline_semaphore = has.timeline_semaphore;
  external_.external_memory_fd = has.external_memory_fd;

  const float priority = 1;
  auto queue = vk_struct<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
  queue.queueFamilyIndex = external_.queue_family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  auto storage = vk_struct<VkPhysicalDevice16BitStorageFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES);
  storage.storageBuffer16BitAccess = storage_16bit;
  auto address = vk_struct<VkPhysicalDeviceBufferDeviceAddressFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES);
  address.bufferDeviceAddress = VK_TRUE;
  VkPhysicalDeviceFeatures features{};
  features.shaderStorageImageWriteWithoutFormat = external_.image_writes;
  CooperativeMatrixFeatures matrix(&storage, true);
  std::vector<const char*> extensions;
  auto info = vk_struct<VkDeviceCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, &storage);
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  info.pEnabledFeatures = &features;
  if (external_.buffer_device_address) {
    storage.pNext = &address;
    features.shaderInt64 = VK_TRUE;
    extensions.push_back(VK_KHR_BUFFER_DEVICE_ADDRESS_EXTENSION_NAME);
  }
  auto timeline = vk_struct<VkPhysicalDeviceTimelineSemaphoreFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES);
  timeline.timelineSemaphore = VK_TRUE;
  if (external_.timeline_semaphore) {
    timeline.pNext = storage.pNext;
    storage.pNext = &timeline;
    extensions.push_back(VK_KHR_TIMELINE_SEMAPHORE_EXTENSION_NAME);
  }
  if (external_.float_controls) extensions.push_back(VK_KHR_SHADER_FLOAT_CONTROLS_EXTENSION_NAME);
  if (external_.external_memory_fd) extensions.push_back(VK_KHR_EXTERNAL_MEMORY_FD_EXTENSION_NAME);
  if (has.dma_buf) extensions.push_back(VK_EXT_EXTERNAL_MEMORY_DMA_BUF_EXTENSION_NAME);
  if (external_.cooperative_matrix) {
    info.pNext = &matrix.matrix;
    extensions.insert(extensions.end(), matrix.kExtensions.begin(), matrix.kExtensions.end());
  }
  HalfDotFeatures dots(const_cast<void*>(info.pNext), true, external_.cooperative_matrix);
  if (external_.half_dots) {
    info.pNext = &dots.dots;
    extensions.insert(extensions.end(), dots.extensions().begin(), dots.extensions().end());
  }
  info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  check(vk_.CreateDevice(external_.physical_device, &info, nullptr, &external_.device), "creating a device");
  vk_.load_device(external_.device);
  vk_.GetDeviceQueue(external_.device, external_.queue_family, 0, &external_.queue);
  interposed() = {};
}

CallerDevice::~CallerDevice() {
  vk_.DestroyDevice(external_.device, nullptr);
  if (messenger_) vk_.DestroyDebugUtilsMessengerEXT(external_.instance, messenger_, nullptr);
  vk_.DestroyInstance(external_.instance, nullptr);
  for (const std::string& message : messages_) ADD_FAILURE() << message;
}

std::map<std::string, int> CallerDevice::take_calls() { return std::exchange(interposed().calls, {}); }

CallerMemory::CallerMemory(const CallerDevice& device, VkDeviceSize size_bytes, uint32_t type_bits,
                           bool device_address)
    : device_(device) {
  const VulkanFunctions& vk = device.vk();
  VkPhysicalDeviceMemoryProperties types;
  vk.GetPhysicalDeviceMemoryProperties(device.external().physical_device, &types);
  constexpr VkMemoryPropertyFlags kSeen =
      VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  uint32_t type = 0;
  while (type < types.memoryTypeCount &&
         (!(type_bits & 1u << type) || (types.memoryTypes[type].propertyFlags & kSeen) != kSeen))
    ++type;
  if (type == types.memoryTypeCount) return;
  auto flags = vk_struct<VkMemoryAllocateFlagsInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO);
  flags.flags = device_address ? VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT : 0;
  auto info = vk_struct<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, &flags);
  info.allocationSize = size_bytes;
  info.memoryTypeIndex = type;
  check(vk.AllocateMemory(device.external().device, &info, nullptr, &memory_), "allocating");
  void* mapped = nullptr;
  check(vk.MapMemory(device.external().device, memory_, 0, VK_WHOLE_SIZE, 0, &mapped), "mapping");
  bytes_ = {static_cast<uint8_t*>(mapped), size_bytes};
  std::ranges::fill(bytes_, uint8_t{0xff});
}

CallerMemory::~CallerMemory() { device_.vk().FreeMemory(device_.external().device, memory_, nullptr); }

bool CallerMemory::is_untouched(VkDeviceSize begin, VkDeviceSize end) const {
  return std::ranges::all_of(bytes_.subspan(begin, end - begin), [](uint8_t byte) { return byte == 0xff; });
}

}  // namespace raymeld::test
