#include "instance.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <vector>

namespace postpass {
namespace {

constexpr const char* kLayer = "VK_LAYER_KHRONOS_validation";

VKAPI_ATTR VkBool32 VKAPI_CALL print(VkDebugUtilsMessageSeverityFlagBitsEXT, VkDebugUtilsMessageTypeFlagsEXT,
                                     const VkDebugUtilsMessengerCallbackDataEXT* data, void* count) {
  ++*static_cast<uint32_t*>(count);
  std::fprintf(stderr, "%s\n", data->pMessage);
  return VK_FALSE;
}

}  // namespace

Instance::Instance(std::span<const char* const> extensions, bool validate) {
  std::vector<const char*> enabled(extensions.begin(), extensions.end());
  std::vector<const char*> layers;
  const vk::ApplicationInfo application{.pApplicationName = "postpass", .apiVersion = VK_API_VERSION_1_1};
  bool synchronization = false;
  const auto feature = vk::ValidationFeatureEnableEXT::eSynchronizationValidation;
  const vk::ValidationFeaturesEXT features{.enabledValidationFeatureCount = 1,
                                           .pEnabledValidationFeatures = &feature};
  if (validate) {
    const auto all = vk::enumerateInstanceLayerProperties();
    if (std::none_of(all.begin(), all.end(),
                     [](auto& layer) { return !std::strcmp(layer.layerName, kLayer); }))
      throw std::runtime_error(std::string("--validate needs ") + kLayer +
                               ", in Debian the package vulkan-validationlayers");
    layers = {kLayer};
    for (const auto& extension : vk::enumerateInstanceExtensionProperties(std::string(kLayer)))
      if (!std::strcmp(extension.extensionName, VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME))
        synchronization = true;
    if (synchronization) enabled.push_back(VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME);
    enabled.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
  }
  instance_ = vk::createInstanceUnique({.pNext = synchronization ? &features : nullptr,
                                        .pApplicationInfo = &application,
                                        .enabledLayerCount = uint32_t(layers.size()),
                                        .ppEnabledLayerNames = layers.data(),
                                        .enabledExtensionCount = uint32_t(enabled.size()),
                                        .ppEnabledExtensionNames = enabled.data()});
  if (!validate) return;
  const vk::DebugUtilsMessengerCreateInfoEXT info{
      .messageSeverity = vk::DebugUtilsMessageSeverityFlagBitsEXT::eWarning |
                         vk::DebugUtilsMessageSeverityFlagBitsEXT::eError,
      .messageType = vk::DebugUtilsMessageTypeFlagBitsEXT::eValidation |
                     vk::DebugUtilsMessageTypeFlagBitsEXT::ePerformance,
      .pfnUserCallback = print,
      .pUserData = &messages_};
  const auto create = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(
      instance_->getProcAddr("vkCreateDebugUtilsMessengerEXT"));
  const VkDebugUtilsMessengerCreateInfoEXT& plain = info;
  vk::resultCheck(vk::Result(create(*instance_, &plain, nullptr, &messenger_)), "creating a messenger");
}

Instance::~Instance() {
  if (!messenger_) return;
  const auto destroy = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(
      instance_->getProcAddr("vkDestroyDebugUtilsMessengerEXT"));
  destroy(*instance_, messenger_, nullptr);
}

}  // namespace postpass
