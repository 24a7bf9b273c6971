// Holds all that lives as long as the device, whether raymeld made the device or the caller did.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "engine/cooperative_matrix.h"
#include "engine/external.h"
#include "engine/float_controls.h"
#include "engine/vulkan.h"

namespace raymeld {

class ConstantPool;
class KernelPool;

// Holds the facts of a physical device that decide how, and whether, raymeld runs on it. `raymeld devices`
// shows them.
struct DeviceInfo {
  uint32_t index = 0;
  std::string name;
  std::string type;  // "discrete GPU", "integrated GPU", "virtual GPU", "CPU", "other"
  std::string uuid;  // 8-4-4-4-12 hexadecimal digits
  std::string driver;
  uint32_t api_version = 0;
  uint64_t memory_bytes = 0;             // largest device-local heap, or its budget where the driver tells it
  uint64_t max_storage_range_bytes = 0;  // longest range of one binding
  uint64_t max_allocation_bytes = 0;
  uint32_t storage_alignment_bytes = 0;  // divides a binding's offset
  uint32_t max_storage_buffers = 0;      // bindings of one shader
  uint32_t max_push_bytes = 0;           // push constants of one shader
  std::array<uint32_t, 3> max_groups{};  // workgroups of one dispatch
  uint32_t subgroup_size = 0;
  uint32_t vector_lanes = 0;  // size of subgroups that the driver makes vectors of, or 0: see vector.glsl
  uint32_t id_lanes = 0;      // the same where the driver divides to find ids, or 0: see ids.glsl
  double timestamp_period_ns = 0;  // 0: no timestamps on the queue
  uint32_t timestamp_bits = 0;     // bits of a timestamp that count, after which it starts again at 0
  bool is_cpu = false;
  bool storage_16bit = false;
  bool float16_arithmetic = false;
  bool image_writes = false;           // any format: shaderStorageImageWriteWithoutFormat
  bool buffer_device_address = false;  // includes 64-bit integers, the type of addresses
  std::optional<CooperativeMatrix> cooperative_matrix;
  bool half_dots = false;  // see half_dots.h
  FloatControls float_controls;
  bool is_portable_subset = false;  // VK_KHR_portability_subset: Vulkan on top of another interface
  bool timeline_semaphore = false;
  bool external_memory_fd = false;  // VK_KHR_external_memory_fd
  bool dma_buf = false;             // VK_EXT_external_memory_dma_buf

  // Returns the time between two timestamps of the queue, the second of which may have started again at 0.
  double ms_between(uint64_t from, uint64_t to) const {
    const uint64_t ticks = (to - from) & (timestamp_bits < 64 ? (uint64_t{1} << timestamp_bits) - 1 : ~0ull);
    return static_cast<double>(ticks) * timestamp_period_ns * 1e-6;
  }
};

// Returns all devices, in the driver's order. Throws Error without a loader or without a device.
std::vector<DeviceInfo> list_devices();

// Chooses what the Khronos layer validates: nothing; its usual checks and hazards between commands; with
// kGpuAssisted also where shaders access memory, which is slow.
enum class Validation { kNone, kSynchronization, kGpuAssisted };

struct DeviceRequest {
  // Is an index, a UUID or a part of the name in any case. Empty selects the first discrete GPU, else the
  // first integrated GPU, virtual GPU or CPU.
  std::string selector;
  Validation validation = Validation::kNone;
  bool pipeline_statistics = false;  // asks the driver to keep what pipeline_executables() reads
  // Is called with each warning and error of the validation layers, those of the device's end included, by
  // any thread but one at a time.
  std::function<void(const std::string&)> on_message = {};
};

// Several threads may use a Device at once. An object made from it, such as a Program, is for one at a time.
class Device {
 public:
  static std::unique_ptr<Device> create(const DeviceRequest& request = {});
  static std::unique_ptr<Device> wrap(const ExternalDevice& external);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  const VulkanFunctions& vk() const { return vk_; }
  VkPhysicalDevice physical_device() const { return physical_device_; }
  VkDevice handle() const { return device_; }
  VkQueue queue() const { return queue_; }
  uint32_t queue_family() const { return queue_family_; }
  // Returns the allocator of all that is made on the device; null is the driver's own.
  const VkAllocationCallbacks* allocator() const { return allocator_; }
  VkPipelineCache pipeline_cache() const { return pipeline_cache_; }  // the caller's, or null
  const DeviceInfo& info() const { return info_; }
  const VkPhysicalDeviceProperties& properties() const { return properties_; }
  const VkPhysicalDeviceMemoryProperties& memory() const { return memory_; }

  ConstantPool& constants() const { return *constants_; }
  KernelPool& kernels() const { return *kernels_; }

  // Returns whether pipelines are made with statistics: they were asked for, and the driver has them.
  bool tells_statistics() const { return tells_statistics_; }
  // Returns whether raymeld made the device, and not the caller.
  bool is_own() const { return owns_; }

  // Names an object for debuggers and validation messages; does nothing without VK_EXT_debug_utils.
  template <typename Handle>
  void name(VkObjectType type, Handle handle, const std::string& text) const {
    name_object(type, reinterpret_cast<uint64_t>(handle), text);
  }

  // Submits to the queue. Threads take turns, also those of other Devices that wrap the same queue.
  void submit(const VkSubmitInfo& submit, VkFence fence) const;

  // Submits one command buffer and waits until the device has done it. Threads that share this Device take
  // turns until the wait ends. If the wait fails, waits until the queue is idle, if it can, and throws.
  void submit_and_wait(VkCommandBuffer commands) const;

 private:
  Device();
  void create_instance(Validation validation);
  void create_device();
  uint32_t find_queue_family() const;
  void adopt_queue_family(uint32_t family);
  void adopt(VkPhysicalDevice physical_device, uint32_t index);
  static VKAPI_ATTR VkBool32 VKAPI_CALL pass_message_on(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                                        VkDebugUtilsMessageTypeFlagsEXT,
                                                        const VkDebugUtilsMessengerCallbackDataEXT* data,
                                                        void* device);
  void name_object(VkObjectType type, uint64_t handle, const std::string& text) const;

  VulkanFunctions vk_;
  bool owns_ = false;
  bool tells_statistics_ = false;
  VkInstance instance_ = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  VkPhysicalDevice physical_device_ = VK_NULL_HANDLE;
  VkDevice device_ = VK_NULL_HANDLE;
  VkQueue queue_ = VK_NULL_HANDLE;
  uint32_t queue_family_ = 0;
  const VkAllocationCallbacks* allocator_ = nullptr;
  VkPipelineCache pipeline_cache_ = VK_NULL_HANDLE;
  std::shared_ptr<std::mutex> queue_mutex_;
  VkFence fence_ = VK_NULL_HANDLE;  // used by submit_and_wait()
  mutable std::mutex fence_mutex_;
  std::unique_ptr<ConstantPool> constants_;
  std::unique_ptr<KernelPool> kernels_;
  DeviceInfo info_;
  VkPhysicalDeviceProperties properties_{};
  VkPhysicalDeviceMemoryProperties memory_{};
  std::mutex message_mutex_;
  std::function<void(const std::string&)> on_message_;
};

}  // namespace raymeld
