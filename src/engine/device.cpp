#include "engine/device.h"

#include <map>

#include "engine/constants.h"
#include "engine/half_dots.h"
#include "engine/instance.h"
#include "engine/kernel_pool.h"
#include "engine/pipeline_statistics.h"
#include "error.h"

namespace raymeld {
namespace {

// Returns the mutex of a queue, the same for all Devices that submit to it.
std::shared_ptr<std::mutex> mutex_of(VkQueue queue) {
  static std::mutex guard;
  static std::map<VkQueue, std::weak_ptr<std::mutex>> mutexes;
  const std::lock_guard lock(guard);
  std::erase_if(mutexes, [](const auto& entry) { return entry.second.expired(); });
  std::weak_ptr<std::mutex>& known = mutexes[queue];
  std::shared_ptr<std::mutex> mutex = known.lock();
  if (!mutex) known = mutex = std::make_shared<std::mutex>();
  return mutex;
}

std::vector<VkQueueFamilyProperties> queue_families(const VulkanFunctions& vk, VkPhysicalDevice device) {
  uint32_t count = 0;
  vk.GetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vk.GetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  return families;
}

}  // namespace

VKAPI_ATTR VkBool32 VKAPI_CALL Device::pass_message_on(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                                       VkDebugUtilsMessageTypeFlagsEXT,
                                                       const VkDebugUtilsMessengerCallbackDataEXT* data,
                                                       void* device) {
  auto& self = *static_cast<Device*>(device);
  // Newer layers name the rule beside the text and no longer in it.
  const char* rule = data->pMessageIdName ? data->pMessageIdName : "";
  const std::lock_guard lock(self.message_mutex_);
  if (self.on_message_) self.on_message_(fmt::format("{}: {}", rule, data->pMessage));
  return VK_FALSE;
}

std::unique_ptr<Device> Device::create(const DeviceRequest& request) {
  std::unique_ptr<Device> device(new Device);
  device->owns_ = true;
  device->on_message_ = request.on_message;
  device->vk_ = VulkanFunctions::load();
  device->create_instance(request.validation);
  const auto candidates = physical_devices(device->vk_, device->instance_);
  std::vector<DeviceInfo> infos;
  for (VkPhysicalDevice candidate : candidates) {
    infos.push_back(device_info(device->vk_, candidate, static_cast<uint32_t>(infos.size())));
  }
  const size_t chosen = select_device(infos, request.selector);
  device->adopt(candidates[chosen], static_cast<uint32_t>(chosen));
  device->adopt_queue_family(device->find_queue_family());
  device->tells_statistics_ =
      request.pipeline_statistics && tells_pipeline_statistics(device->vk_, device->physical_device_);
  device->create_device();
  return device;
}

std::unique_ptr<Device> Device::wrap(const ExternalDevice& external) {
  if (!external.get_instance_proc_addr || !external.instance || !external.physical_device ||
      !external.device || !external.queue) {
    throw Error("wrapping a Vulkan device: a handle or get_instance_proc_addr is null");
  }
  std::unique_ptr<Device> device(new Device);
  device->vk_.GetInstanceProcAddr = external.get_instance_proc_addr;
  device->vk_.load_instance(external.instance);
  device->vk_.load_device(external.device);
  device->instance_ = external.instance;
  device->device_ = external.device;
  device->queue_ = external.queue;
  device->queue_mutex_ = mutex_of(external.queue);
  device->allocator_ = external.allocator;
  device->pipeline_cache_ = external.pipeline_cache;
  device->adopt(external.physical_device, 0);
  device->adopt_queue_family(external.queue_family);
  device->info_.storage_16bit = device->info_.storage_16bit && external.storage_16bit;
  device->info_.buffer_device_address = device->info_.buffer_device_address && external.buffer_device_address;
  device->info_.image_writes = device->info_.image_writes && external.image_writes;
  if (!external.cooperative_matrix) device->info_.cooperative_matrix.reset();
  device->info_.half_dots = device->info_.half_dots && external.half_dots;
  if (!external.float_controls) device->info_.float_controls = {};
  device->info_.timeline_semaphore = device->info_.timeline_semaphore && external.timeline_semaphore;
  device->info_.external_memory_fd = device->info_.external_memory_fd && external.external_memory_fd;
  if (device->info_.external_memory_fd && !device->vk_.GetMemoryFdPropertiesKHR) {
    throw Error("wrapping a Vulkan device: VK_KHR_external_memory_fd is said to be enabled, but is not");
  }
  if (device->info_.buffer_device_address && !device->vk_.GetBufferDeviceAddress) {
    throw Error("wrapping a Vulkan device: buffer addresses are said to be enabled, but are not");
  }
  const auto fence = vk_struct<VkFenceCreateInfo>(VK_STRUCTURE_TYPE_FENCE_CREATE_INFO);
  check(device->vk_.CreateFence(device->device_, &fence, device->allocator_, &device->fence_),
        "creating a fence");
  return device;
}

Device::Device() : constants_(std::make_unique<ConstantPool>()), kernels_(std::make_unique<KernelPool>()) {}

Device::~Device() {
  kernels_.reset();  // destroys the kernels that it keeps before the device
  if (device_ && fence_) vk_.DestroyFence(device_, fence_, allocator_);
  if (!owns_) return;
  if (device_) vk_.DestroyDevice(device_, nullptr);
  if (messenger_) vk_.DestroyDebugUtilsMessengerEXT(instance_, messenger_, nullptr);
  if (instance_) vk_.DestroyInstance(instance_, nullptr);
}

void Device::create_instance(Validation validation) {
  instance_ = make_instance(vk_, validation);
  if (validation == Validation::kNone) return;
  auto info =
      vk_struct<VkDebugUtilsMessengerCreateInfoEXT>(VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT);
  info.messageSeverity =
      VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT |
                     VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT |
                     VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
  info.pfnUserCallback = pass_message_on;
  info.pUserData = this;
  check(vk_.CreateDebugUtilsMessengerEXT(instance_, &info, nullptr, &messenger_),
        "creating the validation messenger");
}

void Device::adopt(VkPhysicalDevice physical_device, uint32_t index) {
  physical_device_ = physical_device;
  info_ = device_info(vk_, physical_device, index);
  vk_.GetPhysicalDeviceProperties(physical_device, &properties_);
  vk_.GetPhysicalDeviceMemoryProperties(physical_device, &memory_);
}

// Prefers a compute family without graphics, which runs beside a desktop's rendering.
uint32_t Device::find_queue_family() const {
  const auto families = queue_families(vk_, physical_device_);
  std::optional<uint32_t> found;
  for (uint32_t i = 0; i < families.size(); ++i) {
    if (!(families[i].queueFlags & VK_QUEUE_COMPUTE_BIT)) continue;
    if (!found || !(families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT)) found = i;
  }
  if (!found) throw Error("device {} has no compute queue", info_.name);
  return *found;
}

void Device::adopt_queue_family(uint32_t family) {
  queue_family_ = family;
  const auto families = queue_families(vk_, physical_device_);
  if (family >= families.size())
    throw Error("device {} has {} queue families, and no family {}", info_.name, families.size(), family);
  info_.timestamp_bits = families[family].timestampValidBits;
  if (info_.timestamp_bits == 0) info_.timestamp_period_ns = 0;
}

void Device::create_device() {
  const float priority = 1.0f;
  auto queue = vk_struct<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
  queue.queueFamilyIndex = queue_family_;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  auto storage = vk_struct<VkPhysicalDevice16BitStorageFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES);
  storage.storageBuffer16BitAccess = info_.storage_16bit;
  auto address = vk_struct<VkPhysicalDeviceBufferDeviceAddressFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES);
  address.bufferDeviceAddress = VK_TRUE;
  VkPhysicalDeviceFeatures features{};
  features.shaderStorageImageWriteWithoutFormat = info_.image_writes;
  std::vector<const char*> extensions;
  if (info_.buffer_device_address) {
    storage.pNext = &address;
    features.shaderInt64 = VK_TRUE;
    extensions.push_back(VK_KHR_BUFFER_DEVICE_ADDRESS_EXTENSION_NAME);
  }
  if (info_.external_memory_fd) extensions.push_back(VK_KHR_EXTERNAL_MEMORY_FD_EXTENSION_NAME);
  if (info_.dma_buf) extensions.push_back(VK_EXT_EXTERNAL_MEMORY_DMA_BUF_EXTENSION_NAME);
  if (info_.float_controls.any()) extensions.push_back(VK_KHR_SHADER_FLOAT_CONTROLS_EXTENSION_NAME);
  if (info_.is_portable_subset) extensions.push_back(kPortabilitySubset);
  auto statistics = vk_struct<VkPhysicalDevicePipelineExecutablePropertiesFeaturesKHR>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PIPELINE_EXECUTABLE_PROPERTIES_FEATURES_KHR, &storage);
  statistics.pipelineExecutableInfo = VK_TRUE;
  void* chain = tells_statistics_ ? static_cast<void*>(&statistics) : &storage;
  CooperativeMatrixFeatures matrix(chain, info_.cooperative_matrix.has_value());
  if (tells_statistics_) extensions.push_back(VK_KHR_PIPELINE_EXECUTABLE_PROPERTIES_EXTENSION_NAME);
  if (info_.cooperative_matrix) {
    extensions.insert(extensions.end(), matrix.kExtensions.begin(), matrix.kExtensions.end());
    chain = &matrix.matrix;
  }
  HalfDotFeatures dots(chain, info_.half_dots, info_.cooperative_matrix.has_value());
  if (info_.half_dots) {
    extensions.insert(extensions.end(), dots.extensions().begin(), dots.extensions().end());
    chain = &dots.dots;
  }
  info_.timeline_semaphore = false;  // no caller can make a semaphore of this device
  auto info = vk_struct<VkDeviceCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO);
  info.pNext = chain;
  info.pEnabledFeatures = &features;
  info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  check(vk_.CreateDevice(physical_device_, &info, nullptr, &device_), "creating device " + info_.name);
  vk_.load_device(device_);
  vk_.GetDeviceQueue(device_, queue_family_, 0, &queue_);
  queue_mutex_ = mutex_of(queue_);
  const auto fence = vk_struct<VkFenceCreateInfo>(VK_STRUCTURE_TYPE_FENCE_CREATE_INFO);
  check(vk_.CreateFence(device_, &fence, nullptr, &fence_), "creating a fence");
}

void Device::name_object(VkObjectType type, uint64_t handle, const std::string& text) const {
  if (!vk_.SetDebugUtilsObjectNameEXT) return;
  auto info = vk_struct<VkDebugUtilsObjectNameInfoEXT>(VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT);
  info.objectType = type;
  info.objectHandle = handle;
  info.pObjectName = text.c_str();
  check(vk_.SetDebugUtilsObjectNameEXT(device_, &info), "naming " + text);
}

void Device::submit(const VkSubmitInfo& submit, VkFence fence) const {
  const std::lock_guard lock(*queue_mutex_);
  check(vk_.QueueSubmit(queue_, 1, &submit, fence), "submitting to " + info_.name);
}

void Device::submit_and_wait(VkCommandBuffer commands) const {
  auto info = vk_struct<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  info.commandBufferCount = 1;
  info.pCommandBuffers = &commands;
  const std::lock_guard turn(fence_mutex_);
  check(vk_.ResetFences(device_, 1, &fence_), "resetting a fence");
  submit(info, fence_);
  const VkResult waited = vk_.WaitForFences(device_, 1, &fence_, VK_TRUE, UINT64_MAX);
  // The caller will free memory that the device may still be using.
  if (waited != VK_SUCCESS) {
    const std::lock_guard lock(*queue_mutex_);
    vk_.QueueWaitIdle(queue_);
  }
  check(waited, "waiting for " + info_.name);
}

}  // namespace raymeld
