#include "engine/vulkan.h"

#include "error.h"
#include "platform/shared_library.h"

namespace raymeld {
namespace {

PFN_vkGetInstanceProcAddr find_loader() {
  const auto [address, reason] = load_symbol(vulkan_loaders(), "vkGetInstanceProcAddr");
  if (address) return reinterpret_cast<PFN_vkGetInstanceProcAddr>(address);
  throw Error("no Vulkan loader: {}; install it and a driver (Debian's libvulkan1 and mesa-vulkan-drivers)",
              reason ? reason : "it was not found");
}

template <typename Function>
void require(Function& function, PFN_vkVoidFunction address, const char* name) {
  function = reinterpret_cast<Function>(address);
  if (!function) throw Error("the Vulkan driver lacks vk{}, which Vulkan 1.1 requires", name);
}

}  // namespace

VulkanFunctions VulkanFunctions::load() {
  static const PFN_vkGetInstanceProcAddr loader = find_loader();
  VulkanFunctions vk;
  vk.GetInstanceProcAddr = loader;
#define RAYMELD_LOAD(name) require(vk.name, vk.GetInstanceProcAddr(nullptr, "vk" #name), #name);
  RAYMELD_GLOBAL_FUNCTIONS(RAYMELD_LOAD)
#undef RAYMELD_LOAD
  return vk;
}

void VulkanFunctions::load_instance(VkInstance instance) {
#define RAYMELD_LOAD(name) require(name, GetInstanceProcAddr(instance, "vk" #name), #name);
  RAYMELD_INSTANCE_FUNCTIONS(RAYMELD_LOAD)
#undef RAYMELD_LOAD
#define RAYMELD_LOAD(name) name = reinterpret_cast<PFN_vk##name>(GetInstanceProcAddr(instance, "vk" #name));
  RAYMELD_LOAD(CreateDebugUtilsMessengerEXT)
  RAYMELD_LOAD(DestroyDebugUtilsMessengerEXT)
  RAYMELD_LOAD(SetDebugUtilsObjectNameEXT)
  RAYMELD_LOAD(GetPhysicalDeviceCooperativeMatrixPropertiesKHR)
#undef RAYMELD_LOAD
}

void VulkanFunctions::load_device(VkDevice device) {
#define RAYMELD_LOAD(name) require(name, GetDeviceProcAddr(device, "vk" #name), #name);
  RAYMELD_DEVICE_FUNCTIONS(RAYMELD_LOAD)
#undef RAYMELD_LOAD
  GetPipelineExecutablePropertiesKHR = reinterpret_cast<PFN_vkGetPipelineExecutablePropertiesKHR>(
      GetDeviceProcAddr(device, "vkGetPipelineExecutablePropertiesKHR"));
  GetPipelineExecutableStatisticsKHR = reinterpret_cast<PFN_vkGetPipelineExecutableStatisticsKHR>(
      GetDeviceProcAddr(device, "vkGetPipelineExecutableStatisticsKHR"));
  GetMemoryFdPropertiesKHR = reinterpret_cast<PFN_vkGetMemoryFdPropertiesKHR>(
      GetDeviceProcAddr(device, "vkGetMemoryFdPropertiesKHR"));
  GetBufferDeviceAddress = reinterpret_cast<PFN_vkGetBufferDeviceAddress>(
      GetDeviceProcAddr(device, "vkGetBufferDeviceAddressKHR"));
  if (GetBufferDeviceAddress) return;
  GetBufferDeviceAddress =
      reinterpret_cast<PFN_vkGetBufferDeviceAddress>(GetDeviceProcAddr(device, "vkGetBufferDeviceAddress"));
}

std::string result_name(VkResult result) {
  switch (result) {
#define RAYMELD_CASE(code) \
  case code:               \
    return #code;
    RAYMELD_CASE(VK_SUCCESS)
    RAYMELD_CASE(VK_NOT_READY)
    RAYMELD_CASE(VK_TIMEOUT)
    RAYMELD_CASE(VK_INCOMPLETE)
    RAYMELD_CASE(VK_ERROR_OUT_OF_HOST_MEMORY)
    RAYMELD_CASE(VK_ERROR_OUT_OF_DEVICE_MEMORY)
    RAYMELD_CASE(VK_ERROR_INITIALIZATION_FAILED)
    RAYMELD_CASE(VK_ERROR_DEVICE_LOST)
    RAYMELD_CASE(VK_ERROR_MEMORY_MAP_FAILED)
    RAYMELD_CASE(VK_ERROR_LAYER_NOT_PRESENT)
    RAYMELD_CASE(VK_ERROR_EXTENSION_NOT_PRESENT)
    RAYMELD_CASE(VK_ERROR_FEATURE_NOT_PRESENT)
    RAYMELD_CASE(VK_ERROR_INCOMPATIBLE_DRIVER)
    RAYMELD_CASE(VK_ERROR_TOO_MANY_OBJECTS)
    RAYMELD_CASE(VK_ERROR_OUT_OF_POOL_MEMORY)
    RAYMELD_CASE(VK_ERROR_INVALID_EXTERNAL_HANDLE)
#undef RAYMELD_CASE
    default:
      return fmt::format("VkResult {}", static_cast<int>(result));
  }
}

void check(VkResult result, const std::string& what) {
  if (result == VK_SUCCESS) return;
  if (result == VK_ERROR_OUT_OF_DEVICE_MEMORY) throw OutOfMemory("{}: {}", what, result_name(result));
  if (result == VK_ERROR_OUT_OF_HOST_MEMORY) throw OutOfHostMemory("{}: {}", what, result_name(result));
  if (result != VK_ERROR_DEVICE_LOST) throw Error("{}: {}", what, result_name(result));
  throw DeviceLost(
      "{}: {}: the driver has reset or lost the device, for example after a hang, a crash or work that took "
      "too long; try again, and if that fails, try less memory (smaller tiles), the direct kernels, another "
      "version of the driver or another device",
      what, result_name(result));
}

}  // namespace raymeld
