#include "faults.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "engine/khr_cooperative_matrix.h"
#include "gate.h"

namespace raymeld::test {
namespace {

// Each row names a function that makes an object and the function that destroys it.
#define MAKING_FUNCTIONS(X)                                \
  X(CreateInstance, DestroyInstance)                       \
  X(CreateDevice, DestroyDevice)                           \
  X(AllocateMemory, FreeMemory)                            \
  X(CreateBuffer, DestroyBuffer)                           \
  X(CreateDescriptorSetLayout, DestroyDescriptorSetLayout) \
  X(CreatePipelineLayout, DestroyPipelineLayout)           \
  X(CreateDescriptorPool, DestroyDescriptorPool)           \
  X(CreateCommandPool, DestroyCommandPool)                 \
  X(CreateShaderModule, DestroyShaderModule)               \
  X(CreatePipelineCache, DestroyPipelineCache)             \
  X(CreateComputePipelines, DestroyPipeline)               \
  X(CreateFence, DestroyFence)                             \
  X(CreateQueryPool, DestroyQueryPool)

// These functions may fail too; objects of AllocateX() go with their pool.
#define OTHER_FUNCTIONS(X)                           \
  X(EnumeratePhysicalDevices)                        \
  X(EnumerateDeviceExtensionProperties)              \
  X(GetPhysicalDeviceCooperativeMatrixPropertiesKHR) \
  X(SetDebugUtilsObjectNameEXT)                      \
  X(BindBufferMemory)                                \
  X(MapMemory)                                       \
  X(FlushMappedMemoryRanges)                         \
  X(InvalidateMappedMemoryRanges)                    \
  X(AllocateDescriptorSets)                          \
  X(AllocateCommandBuffers)                          \
  X(BeginCommandBuffer)                              \
  X(ResetCommandBuffer)                              \
  X(EndCommandBuffer)                                \
  X(GetPipelineCacheData)                            \
  X(ResetFences)                                     \
  X(QueueSubmit)                                     \
  X(WaitForFences)                                   \
  X(GetQueryPoolResults)                             \
  X(GetMemoryFdPropertiesKHR)                        \
  X(QueueWaitIdle)                                   \
  X(DeviceWaitIdle)

constexpr bool may_lose_the_device(std::string_view function) {
  for (const char* name : {"vkCreateDevice", "vkQueueSubmit", "vkWaitForFences", "vkGetQueryPoolResults",
                           "vkQueueWaitIdle", "vkDeviceWaitIdle"}) {
    if (function == name) return true;
  }
  return false;
}

// This mutex is held while calls are counted, not while they are made.
std::mutex counting;

// Counts this call and returns whether it is to fail.
bool fails(const char* function) {
  const std::lock_guard lock(counting);
  Interposed& state = interposed();
  Fault& fault = state.fault;
  ++state.calls[function];
  const bool lost = fault.code == VK_ERROR_DEVICE_LOST;
  if (fault.call == 0 || (lost && !may_lose_the_device(function))) return false;
  const bool after_loss = lost && state.failures > 0;
  if (!after_loss && !fault.function.empty() && fault.function != function) return false;
  if (fault.call > 1) return --fault.call, false;
  if (!lost && !fault.lasting) fault.call = 0;
  if (state.failures++ == 0) {
    state.failed = function;
    state.alive_at_failure = state.alive;
  }
  return true;
}

void hold_back(std::string_view function) {
  Hold hold;
  {
    const std::lock_guard lock(counting);
    hold = interposed().hold;
    if (function != "vkQueueSubmit" || interposed().calls.at("vkQueueSubmit") != hold.call) return;
  }
  wait_for_file(hold.file);
}

void count_made(const char* function) {
  const std::lock_guard lock(counting);
  ++interposed().alive[function];
}

void count_destroyed(const char* made_by) {
  const std::lock_guard lock(counting);
  if (--interposed().alive[made_by] == 0) interposed().alive.erase(made_by);
}

void finish_the_work_of_the_device();

bool is_beyond_the_limit(const VkMemoryAllocateInfo* info) {
  return info->allocationSize > interposed().most_allocation_bytes;
}

// Stands in for a function; each Name has its own `real`.
template <typename Name, typename Function>
struct Shim;

template <typename Name, typename Result, typename... Arguments>
struct Shim<Name, Result(VKAPI_PTR*)(Arguments...)> {
  static inline std::atomic<Result(VKAPI_PTR*)(Arguments...)> real = nullptr;

  static Result VKAPI_CALL call(Arguments... arguments) {
    [[maybe_unused]] const auto all = std::tie(arguments...);
    if constexpr (std::is_void_v<Result>) {
      // The handle is the argument before the allocator.
      const bool exists = std::get<sizeof...(Arguments) - 2>(all) != VK_NULL_HANDLE;
      if (exists) count_destroyed(Name::made_by);
      real.load()(arguments...);
    } else {
      if (fails(Name::text)) {
        const VkResult code = interposed().fault.code;
        if (code == VK_ERROR_DEVICE_LOST) finish_the_work_of_the_device();
        return code;
      }
      [[maybe_unused]] VkMemoryAllocateInfo allocation;
      if constexpr (std::is_same_v<std::tuple_element_t<1, std::tuple<Arguments..., void*>>,
                                   const VkMemoryAllocateInfo*>) {
        if (is_beyond_the_limit(std::get<1>(all))) return VK_ERROR_OUT_OF_DEVICE_MEMORY;
        allocation = *std::get<1>(all);
        if (interposed().discrete) allocation.memoryTypeIndex = 0;
        std::get<1>(all) = &allocation;
      }
      hold_back(Name::text);
      const VkResult result = real.load()(arguments...);
      if (Name::makes && result == VK_SUCCESS) count_made(Name::text);
      return result;
    }
  }
};

#define NAME_OF(function, is_maker)                     \
  struct Name##function {                               \
    static constexpr const char* text = "vk" #function; \
    static constexpr bool makes = is_maker;             \
  };
#define NAME_PAIR(make, destroy)                       \
  NAME_OF(make, true)                                  \
  struct Name##destroy {                               \
    static constexpr const char* text = "vk" #destroy; \
    static constexpr const char* made_by = "vk" #make; \
  };
#define NAME_OTHER(function) NAME_OF(function, false)
MAKING_FUNCTIONS(NAME_PAIR)
OTHER_FUNCTIONS(NAME_OTHER)

void finish_the_work_of_the_device() {
  const auto wait = Shim<NameDeviceWaitIdle, PFN_vkDeviceWaitIdle>::real.load();
  if (wait && interposed().device) wait(interposed().device);
}

template <typename Name, typename Function>
bool try_interpose(const char* name, PFN_vkVoidFunction& function) {
  if (std::string_view(name) != Name::text) return false;
  using Counter = Shim<Name, Function>;
  Counter::real = reinterpret_cast<Function>(function);
  function = reinterpret_cast<PFN_vkVoidFunction>(&Counter::call);
  return true;
}

template <typename Function>
std::atomic<Function> real_function = nullptr;

void note_copy(const char* what) {
  const std::lock_guard lock(counting);
  interposed().copies.push_back(what);
}

// These two lower limits that the driver tells.
VKAPI_ATTR void VKAPI_CALL get_properties(VkPhysicalDevice device, VkPhysicalDeviceProperties2* properties) {
  real_function<PFN_vkGetPhysicalDeviceProperties2>.load()(device, properties);
  uint32_t& most = properties->properties.limits.maxPerStageDescriptorStorageBuffers;
  most = std::min(most, interposed().most_storage_buffers);
}

VKAPI_ATTR void VKAPI_CALL get_families(VkPhysicalDevice device, uint32_t* count,
                                        VkQueueFamilyProperties* families) {
  real_function<PFN_vkGetPhysicalDeviceQueueFamilyProperties>.load()(device, count, families);
  for (uint32_t i = 0; families && i < *count; ++i)
    families[i].timestampValidBits = std::min(families[i].timestampValidBits, interposed().timestamp_bits);
}

// These two split a driver's first memory type into the device's own memory and the host's; Shim takes both
// for the first type.
VKAPI_ATTR void VKAPI_CALL get_memory(VkPhysicalDevice device, VkPhysicalDeviceMemoryProperties* memory) {
  real_function<PFN_vkGetPhysicalDeviceMemoryProperties>.load()(device, memory);
  if (!interposed().discrete) return;
  memory->memoryTypeCount = 2;
  memory->memoryTypes[0].propertyFlags = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
  memory->memoryTypes[1] = {VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT, 0};
}

VKAPI_ATTR void VKAPI_CALL get_requirements(VkDevice device, VkBuffer buffer, VkMemoryRequirements* needs) {
  real_function<PFN_vkGetBufferMemoryRequirements>.load()(device, buffer, needs);
  if (interposed().discrete) needs->memoryTypeBits = 3;
}

// These two note what is recorded around a copy.
VKAPI_ATTR void VKAPI_CALL record_barrier(VkCommandBuffer commands, VkPipelineStageFlags from,
                                          VkPipelineStageFlags to, VkDependencyFlags flags, uint32_t count,
                                          const VkMemoryBarrier* barriers, uint32_t buffer_count,
                                          const VkBufferMemoryBarrier* buffers, uint32_t image_count,
                                          const VkImageMemoryBarrier* images) {
  if (from & VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT && to & VK_PIPELINE_STAGE_TRANSFER_BIT && count == 1 &&
      barriers->srcAccessMask & VK_ACCESS_SHADER_WRITE_BIT)
    note_copy("barrier");
  real_function<PFN_vkCmdPipelineBarrier>.load()(commands, from, to, flags, count, barriers, buffer_count,
                                                 buffers, image_count, images);
}

VKAPI_ATTR void VKAPI_CALL record_copy(VkCommandBuffer commands, VkBuffer from, VkBuffer to, uint32_t count,
                                       const VkBufferCopy* regions) {
  note_copy("copy");
  real_function<PFN_vkCmdCopyBuffer>.load()(commands, from, to, count, regions);
}

template <typename Function>
void stand_in_for(const char* own, Function stand_in, const char* name, PFN_vkVoidFunction& function) {
  if (std::string_view(name) != own) return;
  real_function<Function> = reinterpret_cast<Function>(function);
  function = reinterpret_cast<PFN_vkVoidFunction>(stand_in);
}

}  // namespace

Interposed& interposed() {
  static Interposed state;
  return state;
}

void interpose_device(VkDevice device) {
  const std::lock_guard lock(counting);
  interposed().device = device;
}

PFN_vkVoidFunction interpose(const char* name, PFN_vkVoidFunction real) {
  if (!real) return nullptr;
#define TRY_ONE(function) \
  if (try_interpose<Name##function, PFN_vk##function>(name, real)) return real;
#define TRY_PAIR(make, destroy) TRY_ONE(make) TRY_ONE(destroy)
  MAKING_FUNCTIONS(TRY_PAIR)
  OTHER_FUNCTIONS(TRY_ONE)
  stand_in_for("vkGetPhysicalDeviceProperties2", &get_properties, name, real);
  stand_in_for("vkGetPhysicalDeviceQueueFamilyProperties", &get_families, name, real);
  stand_in_for("vkGetPhysicalDeviceMemoryProperties", &get_memory, name, real);
  stand_in_for("vkGetBufferMemoryRequirements", &get_requirements, name, real);
  stand_in_for("vkCmdPipelineBarrier", &record_barrier, name, real);
  stand_in_for("vkCmdCopyBuffer", &record_copy, name, real);
  return real;
}

}  // namespace raymeld::test
