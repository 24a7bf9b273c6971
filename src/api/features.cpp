#include "api/features.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <mutex>

#include "engine/half_dots.h"

namespace raymeld {
namespace {

// Says where a member lies in a structure of a chain.
struct Place {
  VkStructureType type;
  size_t offset_bytes;
};

struct Member {
  const char* name;
  Place own;
  Place core = {VK_STRUCTURE_TYPE_MAX_ENUM, 0};  // the same member in the structure of a version of Vulkan
};

#define RAYMELD_PLACE(type, structure, member) \
  Place { VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_##type, offsetof(VkPhysicalDevice##structure, member) }
#define RAYMELD_MEMBER(type, structure, member, ...) \
  Member { "VkPhysicalDevice" #structure "::" #member, RAYMELD_PLACE(type, structure, member), __VA_ARGS__ }
#define RAYMELD_IN_1_1(member) RAYMELD_PLACE(VULKAN_1_1_FEATURES, Vulkan11Features, member)
#define RAYMELD_IN_1_2(member) RAYMELD_PLACE(VULKAN_1_2_FEATURES, Vulkan12Features, member)
#define RAYMELD_IN_1_3(member) RAYMELD_PLACE(VULKAN_1_3_FEATURES, Vulkan13Features, member)
constexpr std::array kHalfMembers{RAYMELD_MEMBER(16BIT_STORAGE_FEATURES, 16BitStorageFeatures,
                                                 storageBuffer16BitAccess,
                                                 RAYMELD_IN_1_1(storageBuffer16BitAccess))};
constexpr std::array kAddressMembers{
    RAYMELD_MEMBER(BUFFER_DEVICE_ADDRESS_FEATURES, BufferDeviceAddressFeatures, bufferDeviceAddress,
                   RAYMELD_IN_1_2(bufferDeviceAddress)),
    Member{"VkPhysicalDeviceFeatures::shaderInt64",
           RAYMELD_PLACE(FEATURES_2, Features2, features.shaderInt64)}};
constexpr std::array kMatrixMembers{
    RAYMELD_MEMBER(COOPERATIVE_MATRIX_FEATURES_KHR, CooperativeMatrixFeaturesKHR, cooperativeMatrix),
    RAYMELD_MEMBER(VULKAN_MEMORY_MODEL_FEATURES, VulkanMemoryModelFeatures, vulkanMemoryModel,
                   RAYMELD_IN_1_2(vulkanMemoryModel)),
    RAYMELD_MEMBER(VULKAN_MEMORY_MODEL_FEATURES, VulkanMemoryModelFeatures, vulkanMemoryModelDeviceScope,
                   RAYMELD_IN_1_2(vulkanMemoryModelDeviceScope)),
    RAYMELD_MEMBER(SHADER_FLOAT16_INT8_FEATURES, ShaderFloat16Int8Features, shaderFloat16,
                   RAYMELD_IN_1_2(shaderFloat16)),
    RAYMELD_MEMBER(SUBGROUP_SIZE_CONTROL_FEATURES_EXT, SubgroupSizeControlFeaturesEXT, subgroupSizeControl,
                   RAYMELD_IN_1_3(subgroupSizeControl)),
    RAYMELD_MEMBER(SUBGROUP_SIZE_CONTROL_FEATURES_EXT, SubgroupSizeControlFeaturesEXT, computeFullSubgroups,
                   RAYMELD_IN_1_3(computeFullSubgroups))};
constexpr std::array kDotMembers{
    RAYMELD_MEMBER(SHADER_MIXED_FLOAT_DOT_PRODUCT_FEATURES_VALVE, ShaderMixedFloatDotProductFeaturesVALVE,
                   shaderMixedFloatDotProductFloat16AccFloat32),
    RAYMELD_MEMBER(SHADER_FLOAT16_INT8_FEATURES, ShaderFloat16Int8Features, shaderFloat16,
                   RAYMELD_IN_1_2(shaderFloat16))};
constexpr std::array kImageMembers{
    Member{"VkPhysicalDeviceFeatures::shaderStorageImageWriteWithoutFormat",
           RAYMELD_PLACE(FEATURES_2, Features2, features.shaderStorageImageWriteWithoutFormat)}};
constexpr std::array kTimelineMembers{RAYMELD_MEMBER(TIMELINE_SEMAPHORE_FEATURES, TimelineSemaphoreFeatures,
                                                     timelineSemaphore, RAYMELD_IN_1_2(timelineSemaphore))};

constexpr const char* kAddressExtensions[] = {VK_KHR_BUFFER_DEVICE_ADDRESS_EXTENSION_NAME};
constexpr const char* kTimelineExtensions[] = {VK_KHR_TIMELINE_SEMAPHORE_EXTENSION_NAME};
constexpr const char* kFloatExtensions[] = {VK_KHR_SHADER_FLOAT_CONTROLS_EXTENSION_NAME};
constexpr const char* kFdExtensions[] = {VK_KHR_EXTERNAL_MEMORY_FD_EXTENSION_NAME};

struct Feature {
  raymeld_feature_bits bit;
  std::span<const char* const> extensions;
  std::span<const Member> members;
  const char* without;
};

constexpr std::array kFeatures{
    Feature{RAYMELD_FEATURE_STORAGE_16BIT,
            {},
            kHalfMembers,
            "RAYMELD_PRECISION_FP16 is an error and AUTO is FP32, which takes twice the memory and, on GPUs, "
            "more time."},
    Feature{RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS, kAddressExtensions, kAddressMembers,
            "All convolutions are computed directly, which is several times slower on drivers for CPUs. The "
            "extension is part of Vulkan 1.2, where it need not be named."},
    Feature{RAYMELD_FEATURE_COOPERATIVE_MATRIX, CooperativeMatrixFeatures::kExtensions, kMatrixMembers,
            "fp16 convolutions do not use tensor cores, which are several times faster on most GPUs."},
    Feature{RAYMELD_FEATURE_IMAGE_WRITES,
            {},
            kImageMembers,
            "The fused image must be a buffer: output_image is an error."},
    Feature{RAYMELD_FEATURE_TIMELINE_SEMAPHORE, kTimelineExtensions, kTimelineMembers,
            "raymeld_submit() takes binary semaphores only. The extension is part of Vulkan 1.2, where it "
            "need not be named."},
    Feature{RAYMELD_FEATURE_EXTERNAL_MEMORY_FD, kFdExtensions, {}, "raymeld_import_buffer() fails."},
    Feature{
        RAYMELD_FEATURE_FLOAT_CONTROLS,
        kFloatExtensions,
        {},
        "The driver may truncate values to 16 bits and flush small ones to zero, in fp16. The extension is "
        "part of Vulkan 1.2, where it need not be named."},
    Feature{RAYMELD_FEATURE_HALF_DOTS, HalfDotFeatures::kExtensions, kDotMembers,
            "fp16 convolutions that are not computed by cooperative matrices take twice as long."},
};

bool supports(const DeviceInfo& info, raymeld_feature_bits bit) {
  switch (bit) {
    case RAYMELD_FEATURE_STORAGE_16BIT:
      return info.storage_16bit;
    case RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS:
      return info.buffer_device_address;
    case RAYMELD_FEATURE_COOPERATIVE_MATRIX:
      return info.cooperative_matrix.has_value();
    case RAYMELD_FEATURE_IMAGE_WRITES:
      return info.image_writes;
    case RAYMELD_FEATURE_TIMELINE_SEMAPHORE:
      return info.timeline_semaphore;
    case RAYMELD_FEATURE_EXTERNAL_MEMORY_FD:
      return info.external_memory_fd;
    case RAYMELD_FEATURE_FLOAT_CONTROLS:
      return info.float_controls.any();
    case RAYMELD_FEATURE_HALF_DOTS:
      return info.half_dots;
  }
  return false;
}

// Returns the member in the first structure that has it; null where none does.
VkBool32* find(VkPhysicalDeviceFeatures2& chain, const Member& member) {
  for (auto* at = reinterpret_cast<VkBaseOutStructure*>(&chain); at; at = at->pNext) {
    for (const Place& place : {member.own, member.core}) {
      if (at->sType == place.type)
        return reinterpret_cast<VkBool32*>(reinterpret_cast<std::byte*>(at) + place.offset_bytes);
    }
  }
  return nullptr;
}

// Returns the names of the members of feature kFeatures[index].
std::span<const char* const> names_of(size_t index) {
  static const auto all = [] {
    std::array<std::vector<const char*>, kFeatures.size()> names;
    for (size_t i = 0; i < names.size(); ++i)
      for (const Member& member : kFeatures[i].members) names[i].push_back(member.name);
    return names;
  }();
  return all[index];
}

}  // namespace

std::vector<raymeld_feature> features_of(const DeviceInfo& info) {
  std::vector<raymeld_feature> all;
  for (size_t i = 0; i < kFeatures.size(); ++i) {
    raymeld_feature& feature = all.emplace_back();
    feature.bit = kFeatures[i].bit;
    feature.supported = supports(info, kFeatures[i].bit);
    feature.extension_count = static_cast<uint32_t>(kFeatures[i].extensions.size());
    feature.extensions = kFeatures[i].extensions.data();
    feature.member_count = static_cast<uint32_t>(names_of(i).size());
    feature.members = names_of(i).data();
    feature.without = kFeatures[i].without;
  }
  return all;
}

uint32_t enable_features(const DeviceInfo& info, VkPhysicalDeviceFeatures2& chain) {
  uint32_t bits = 0;
  for (const Feature& feature : kFeatures) {
    std::vector<VkBool32*> members;
    for (const Member& member : feature.members) members.push_back(find(chain, member));
    if (!supports(info, feature.bit) || std::ranges::find(members, nullptr) != members.end()) continue;
    for (VkBool32* const member : members) *member = VK_TRUE;
    bits |= feature.bit;
  }
  return bits;
}

std::span<const char* const> extensions_of(uint32_t bits) {
  static std::mutex mutex;
  static std::map<uint32_t, std::vector<const char*>> lists;
  const std::lock_guard lock(mutex);
  const auto [place, is_new] = lists.try_emplace(bits);
  for (const Feature& feature : kFeatures) {
    if (!is_new || !(bits & feature.bit)) continue;
    for (const char* const name : feature.extensions)  // two features may need the same one
      if (std::ranges::find(place->second, std::string_view(name)) == place->second.end())
        place->second.push_back(name);
  }
  return place->second;
}

}  // namespace raymeld
