#include "faults.h"

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
  if (state.failures++ == 0) state.failed = function;
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
      if constexpr (std::is_same_v<std::tuple_element_t<1, std::tuple<Arguments..., void*>>,
                                   const VkMemoryAllocateInfo*>) {
        if (is_beyond_the_limit(std::get<1>(all))) return VK_ERROR_OUT_OF_DEVICE_MEMORY;
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
  return real;
}

}  // namespace raymeld::test
