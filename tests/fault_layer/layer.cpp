// This Vulkan layer makes a driver fail, for tests of whole programs. Its devices have
// VK_KHR_portability_subset, and are made only if that is enabled, as Vulkan demands. It reads the
// environment:
//   RAYMELD_FAULT="FUNCTION CALL CODE"  a call to fail, like "vkCreateBuffer 2 -1" or "any 1 -1": see Fault
//   RAYMELD_MOST_ALLOCATION=BYTES       larger allocations fail
//   RAYMELD_HOLD_SUBMIT="CALL FILE"     that call of vkQueueSubmit waits until FILE exists: see Hold
//   RAYMELD_CALLS=FILE                  gets lines "FUNCTION CALLS ALIVE" at the end of the instance
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan_core.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <span>
#include <sstream>
#include <string_view>

#include "engine/vulkan.h"
#include "faults.h"

namespace raymeld::test {
namespace {

PFN_vkGetInstanceProcAddr next_instance_proc_addr = nullptr;
PFN_vkGetDeviceProcAddr next_device_proc_addr = nullptr;
PFN_vkDestroyInstance next_destroy_instance = nullptr;
PFN_vkCreateDevice next_create_device = nullptr;
PFN_vkEnumerateDeviceExtensionProperties next_extensions = nullptr;

template <typename Function>
Function interposed_as(const char* name, PFN_vkVoidFunction next) {
  return reinterpret_cast<Function>(interpose(name, next));
}

void read_environment() {
  Interposed& state = interposed();
  state = {};
  if (const char* text = std::getenv("RAYMELD_FAULT")) {
    std::istringstream stream(text);
    int code = 0;
    stream >> state.fault.function >> state.fault.call >> code;
    if (state.fault.function == "any") state.fault.function.clear();
    state.fault.code = static_cast<VkResult>(code);
  }
  if (const char* text = std::getenv("RAYMELD_HOLD_SUBMIT"))
    std::istringstream(text) >> state.hold.call >> state.hold.file;
  if (const char* most = std::getenv("RAYMELD_MOST_ALLOCATION"))
    state.most_allocation_bytes = std::strtoull(most, nullptr, 10);
}

void write_calls() {
  const char* file = std::getenv("RAYMELD_CALLS");
  if (!file) return;
  std::ofstream stream(file);
  for (const auto& [function, calls] : interposed().calls) {
    const auto alive = interposed().alive.find(function);
    stream << function << ' ' << calls << ' ' << (alive == interposed().alive.end() ? 0 : alive->second)
           << '\n';
  }
}

// Returns the loader's information on the next layer or driver, from the chain of a creation's structures.
template <typename LayerInfo>
LayerInfo* link_info(const void* next, VkStructureType type) {
  auto* info = const_cast<LayerInfo*>(static_cast<const LayerInfo*>(next));
  while (info && (info->sType != type || info->function != VK_LAYER_LINK_INFO))
    info = const_cast<LayerInfo*>(static_cast<const LayerInfo*>(info->pNext));
  return info;
}

VKAPI_ATTR VkResult VKAPI_CALL create_instance(const VkInstanceCreateInfo* info,
                                               const VkAllocationCallbacks* allocator, VkInstance* instance) {
  auto* link =
      link_info<VkLayerInstanceCreateInfo>(info->pNext, VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO);
  if (!link) return VK_ERROR_INITIALIZATION_FAILED;
  read_environment();
  next_instance_proc_addr = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
  link->u.pLayerInfo = link->u.pLayerInfo->pNext;
  const auto create = interposed_as<PFN_vkCreateInstance>(
      "vkCreateInstance", next_instance_proc_addr(nullptr, "vkCreateInstance"));
  const VkResult result = create(info, allocator, instance);
  if (result != VK_SUCCESS) return result;
  // The loader would answer a later query with the first layer's function.
  next_destroy_instance = interposed_as<PFN_vkDestroyInstance>(
      "vkDestroyInstance", next_instance_proc_addr(*instance, "vkDestroyInstance"));
  next_create_device = interposed_as<PFN_vkCreateDevice>(
      "vkCreateDevice", next_instance_proc_addr(*instance, "vkCreateDevice"));
  next_extensions = interposed_as<PFN_vkEnumerateDeviceExtensionProperties>(
      "vkEnumerateDeviceExtensionProperties",
      next_instance_proc_addr(*instance, "vkEnumerateDeviceExtensionProperties"));
  return result;
}

VKAPI_ATTR void VKAPI_CALL destroy_instance(VkInstance instance, const VkAllocationCallbacks* allocator) {
  next_destroy_instance(instance, allocator);
  write_calls();
}

// Puts the extension in front of the driver's.
VKAPI_ATTR VkResult VKAPI_CALL list_extensions(VkPhysicalDevice physical_device, const char* layer,
                                               uint32_t* count, VkExtensionProperties* extensions) {
  if (layer) return next_extensions(physical_device, layer, count, extensions);
  if (extensions && *count == 0) return VK_INCOMPLETE;
  if (extensions) {
    *extensions = {.extensionName = {}, .specVersion = 1};
    std::strcpy(extensions++->extensionName, kPortabilitySubset);
    --*count;
  }
  const VkResult result = next_extensions(physical_device, layer, count, extensions);
  ++*count;
  return result;
}

VKAPI_ATTR VkResult VKAPI_CALL create_device(VkPhysicalDevice physical_device, const VkDeviceCreateInfo* info,
                                             const VkAllocationCallbacks* allocator, VkDevice* device) {
  auto* link = link_info<VkLayerDeviceCreateInfo>(info->pNext, VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO);
  if (!link) return VK_ERROR_INITIALIZATION_FAILED;
  next_device_proc_addr = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
  link->u.pLayerInfo = link->u.pLayerInfo->pNext;
  const std::span names(info->ppEnabledExtensionNames, info->enabledExtensionCount);
  if (std::ranges::find(names, std::string_view(kPortabilitySubset)) == names.end())
    return VK_ERROR_EXTENSION_NOT_PRESENT;
  return next_create_device(physical_device, info, allocator, device);
}

VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL get_device_proc_addr(VkDevice device, const char* name) {
  if (std::strcmp(name, "vkGetDeviceProcAddr") == 0)
    return reinterpret_cast<PFN_vkVoidFunction>(get_device_proc_addr);
  interpose_device(device);
  return interpose(name, next_device_proc_addr(device, name));
}

VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL get_instance_proc_addr(VkInstance instance, const char* name) {
  const auto is = [name](const char* other) { return std::strcmp(name, other) == 0; };
  if (is("vkGetInstanceProcAddr")) return reinterpret_cast<PFN_vkVoidFunction>(get_instance_proc_addr);
  if (is("vkGetDeviceProcAddr")) return reinterpret_cast<PFN_vkVoidFunction>(get_device_proc_addr);
  if (is("vkCreateInstance")) return reinterpret_cast<PFN_vkVoidFunction>(create_instance);
  if (is("vkDestroyInstance")) return reinterpret_cast<PFN_vkVoidFunction>(destroy_instance);
  if (is("vkCreateDevice")) return reinterpret_cast<PFN_vkVoidFunction>(create_device);
  if (is("vkEnumerateDeviceExtensionProperties"))
    return reinterpret_cast<PFN_vkVoidFunction>(list_extensions);
  return interpose(name, next_instance_proc_addr ? next_instance_proc_addr(instance, name) : nullptr);
}

}  // namespace

extern "C" VK_LAYER_EXPORT VkResult VKAPI_CALL
vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface* negotiated) {
  negotiated->loaderLayerInterfaceVersion = 2;
  negotiated->pfnGetInstanceProcAddr = get_instance_proc_addr;
  negotiated->pfnGetDeviceProcAddr = get_device_proc_addr;
  negotiated->pfnGetPhysicalDeviceProcAddr = nullptr;
  return VK_SUCCESS;
}

}  // namespace raymeld::test
