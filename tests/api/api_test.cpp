// Tests what raymeld.h promises about arguments, versions, errors, handles and the caller's own objects.
#include <vulkan/vulkan_core.h>

#include <cstring>
#include <fstream>
#include <mutex>
#include <new>
#include <set>
#include <thread>

// The public structures have no padding, as compilers may pad in different ways.
#pragma GCC diagnostic push
#pragma GCC diagnostic error "-Wpadded"
#include "raymeld/raymeld.h"
#pragma GCC diagnostic pop

#include "api/features.h"
#include "api_subject.h"
#include "engine/instance.h"
#include "faults.h"
#include "fusion/tuner.h"

namespace raymeld::test {
namespace {

class ApiTest : public testing::Test {
 protected:
  ApiTest() {
    set_cache_home(folder_ / "cache");
    write_model(file_, subject_.architecture, subject_.weights);
  }

  TemporaryDirectory folder_;
  std::string file_ = (folder_ / "model.safetensors").string();
  Subject subject_ = make_subject(small_architecture(2), 6, 9, 1);
  raymeld_fusion_desc desc_ = fusion_desc(subject_);
};

TEST_F(ApiTest, Version) { EXPECT_EQ(raymeld_version(), 0u << 16 | 1u << 8 | 0u); }

TEST_F(ApiTest, FailuresSayWhatWasExpected) {
  const Context context;
  const SharedModel model(file_);
  EXPECT_FAILURE(RAYMELD_ERROR_MODEL, SharedModel("none.safetensors"), "none.safetensors");
  EXPECT_FAILURE(RAYMELD_ERROR_MODEL, SharedModel("junk", 4, "the junk"), "the junk");
  raymeld_context_desc device;
  device.selector = "no such device";
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Context{device}, "no such device");
  device.device = reinterpret_cast<VkDevice>(uintptr_t{16});
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Context{device}, "given together");
  const auto refused = [&](auto raymeld_fusion_desc::*member, auto value, const char* text) {
    raymeld_fusion_desc desc = desc_;
    desc.*member = value;
    EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Fusion(context, model, desc), text);
  };
  refused(&raymeld_fusion_desc::width, 0u, "LRHS of 0 x 6 pixels, expected sides from 1 to 65536");
  refused(&raymeld_fusion_desc::precision, raymeld_precision(3), "precision is 3");
  refused(&raymeld_fusion_desc::kernels, raymeld_kernels(2), "kernels is 2");
  refused(&raymeld_fusion_desc::lrhs_sampling, raymeld_sampling(-1), "lrhs_sampling is");
  refused(&raymeld_fusion_desc::exposure, -1.0f, "exposure");
  refused(&raymeld_fusion_desc::absent_layer_count, 1u, "absent_layers is NULL");
  raymeld_fusion_desc large = desc_;
  large.height = large.width = 50;
  large.max_memory_bytes = 1000;
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(context, model, large), "smallest tile");

  Fusion fusion(context, model, desc_);
  std::vector<float> lrhs(3 * 6 * 9), fused(4 * lrhs.size());
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.fuse(lrhs.data(), nullptr, fused.data()),
                 "hrls is NULL");
  const auto commands = reinterpret_cast<VkCommandBuffer>(uintptr_t{16});  // is not touched
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.record(commands, {}), "lrhs is NULL");
  raymeld_image image;
  const raymeld_frame frame{.lrhs = &image, .hrls = &image, .fused = &image};
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.record(commands, frame), "lrhs: buffer is");
  image.buffer = reinterpret_cast<VkBuffer>(uintptr_t{16});
  image.offset_bytes = 2;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.record(commands, frame), "offset_bytes is 2");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.record(VK_NULL_HANDLE, frame), "commands");
  raymeld_fusion_desc changes = desc_;
  changes.skip_unchanged = VK_TRUE;
  changes.output_image = VK_TRUE;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Fusion(context, model, changes), "skip_unchanged",
                 "output_image");
  EXPECT_EQ(raymeld_model_get_info(nullptr, nullptr), RAYMELD_ERROR_INVALID_ARGUMENT);
  EXPECT_STREQ(raymeld_error(), "model is NULL");
  for (const auto destroy_none :
       {+[] { raymeld_context_destroy(nullptr); }, +[] { raymeld_model_destroy(nullptr); },
        +[] { raymeld_fusion_destroy(nullptr); }, +[] { raymeld_buffer_destroy(nullptr); }})
    destroy_none();
}

TEST_F(ApiTest, AnOutputThatIsNotFiniteIsAFailure) {
  for (double& bias : subject_.weights.at("rec").bias) bias = 3e38;
  for (double& weight : subject_.weights.at("rec").weight) weight = 3e38;
  write_model(file_, subject_.architecture, subject_.weights);
  desc_.precision = RAYMELD_PRECISION_FP32;
  Fusion fusion(Context(), SharedModel(file_), desc_);
  EXPECT_FAILURE(RAYMELD_ERROR_NOT_FINITE, fuse(fusion, subject_), "not finite");
}

TEST_F(ApiTest, ALostDeviceAndALackOfMemoryAreTold) {
  const SharedModel model(file_);
  {
    CallerDevice caller;
    const Context context(context_desc(caller.external()));
    Fusion fusion(context, model, desc_);
    fuse(fusion, subject_);
    interposed().fault = {.function = "vkQueueSubmit", .call = 1, .code = VK_ERROR_DEVICE_LOST};
    EXPECT_FAILURE(RAYMELD_ERROR_DEVICE_LOST, fuse(fusion, subject_), "VK_ERROR_DEVICE_LOST");
  }
  CallerDevice caller;
  const Context context(context_desc(caller.external()));
  for (const char* function : {"vkCreateDescriptorPool", "vkAllocateMemory", "vkCreateShaderModule"}) {
    interposed().fault = {
        .function = function, .call = 1, .code = VK_ERROR_OUT_OF_HOST_MEMORY, .lasting = true};
    EXPECT_FAILURE(RAYMELD_ERROR_OUT_OF_MEMORY, Fusion(context, model, desc_), "VK_ERROR_OUT_OF_HOST_MEMORY");
  }
  interposed().fault = {};
  interposed().most_allocation_bytes = 0;
  EXPECT_FAILURE(RAYMELD_ERROR_OUT_OF_MEMORY, Fusion(context, model, desc_), "allocating");
}

TEST_F(ApiTest, EachThreadHasItsOwnError) {
  raymeld_model model = nullptr;
  EXPECT_EQ(raymeld_model_load(nullptr, &model), RAYMELD_ERROR_INVALID_ARGUMENT);
  std::thread([] {
    EXPECT_STREQ(raymeld_error(), "");
    EXPECT_EQ(raymeld_model_load("x", nullptr), RAYMELD_ERROR_INVALID_ARGUMENT);
    EXPECT_STREQ(raymeld_error(), "model is NULL");
  }).join();
  EXPECT_STREQ(raymeld_error(), "file is NULL");
  EXPECT_EQ(model, nullptr);
}

// Passes and reads structures as a program that was compiled with an older or a newer header would.
TEST_F(ApiTest, StructuresOfOtherVersions) {
  const Context context;
  const SharedModel model(file_);
  raymeld_fusion fusion = nullptr;
  raymeld_fusion_desc older = desc_;
  older.struct_size = offsetof(raymeld_fusion_desc, precision);
  older.precision = raymeld_precision(77);  // lies beyond the older structure's size
  ASSERT_EQ(raymeld_fusion_create(context.get(), model.get(), &older, &fusion), RAYMELD_SUCCESS)
      << raymeld_error();

  struct Newer {
    raymeld_fusion_desc known;
    uint32_t more[2] = {};
  } newer{desc_};
  newer.known.struct_size = sizeof(newer);
  raymeld_fusion other = nullptr;
  EXPECT_EQ(raymeld_fusion_create(context.get(), model.get(), &newer.known, &other), RAYMELD_SUCCESS);
  raymeld_fusion_destroy(std::exchange(other, nullptr));
  newer.more[1] = 1;
  EXPECT_EQ(raymeld_fusion_create(context.get(), model.get(), &newer.known, &other),
            RAYMELD_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(raymeld_error()).find("raymeld_fusion_desc has members"), std::string::npos);
  EXPECT_EQ(other, nullptr);
  desc_.struct_size = 0;
  EXPECT_EQ(raymeld_fusion_create(context.get(), model.get(), &desc_, &other),
            RAYMELD_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(raymeld_error()).find("struct_size is 0"), std::string::npos);
  desc_.struct_size = 5000;  // the structure is not read
  EXPECT_EQ(raymeld_fusion_create(context.get(), model.get(), &desc_, &other),
            RAYMELD_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(raymeld_error()).find("struct_size is 5000"), std::string::npos);
  desc_.struct_size = sizeof(desc_);
  raymeld_frame frame;
  frame.reserved = 1;
  EXPECT_EQ(raymeld_record(fusion, VK_NULL_HANDLE, &frame), RAYMELD_ERROR_INVALID_ARGUMENT);
  EXPECT_STREQ(raymeld_error(), "raymeld_frame: reserved is 1, expected 0");

  const auto small = std::make_unique<size_t>(sizeof(size_t));  // the structure ends after struct_size
  raymeld_context plain = nullptr;
  EXPECT_EQ(raymeld_context_create(reinterpret_cast<const raymeld_context_desc*>(small.get()), &plain),
            RAYMELD_SUCCESS);
  raymeld_context_destroy(plain);

  raymeld_fusion_info info;
  info.struct_size = offsetof(raymeld_fusion_info, tile_height);
  info.tile_height = 1234;
  EXPECT_EQ(raymeld_fusion_get_info(fusion, &info), RAYMELD_SUCCESS);
  EXPECT_EQ(info.scale, 2u);
  EXPECT_EQ(info.tile_height, 1234u);
  EXPECT_EQ(info.struct_size, offsetof(raymeld_fusion_info, tile_height));
  raymeld_fusion_destroy(fusion);
}

TEST_F(ApiTest, WhatWasMadeOutlivesWhatItWasMadeOf) {
  auto context = std::make_unique<Context>();
  auto model = std::make_unique<SharedModel>(file_);
  Fusion first(*context, *model, desc_);
  const std::vector<float> expected = fuse(first, subject_).values;
  Fusion second(*context, *model, desc_);
  context.reset();
  model.reset();
  EXPECT_EQ(fuse(second, subject_).values, expected);
}

TEST_F(ApiTest, AModelInMemoryIsTheOneInAFile) {
  const Context context;
  std::string bytes = read_file(file_);
  const SharedModel model(bytes.data(), bytes.size(), "mine");
  std::ranges::fill(bytes, '\0');  // the model holds a copy
  EXPECT_STREQ(model.info().name, SharedModel(file_).info().name);
  Fusion of_memory(context, model, desc_), of_file(context, SharedModel(file_), desc_);
  EXPECT_EQ(fuse(of_memory, subject_).values, fuse(of_file, subject_).values);
}

TEST_F(ApiTest, StockModelsHaveNames) {
  const std::filesystem::path before = std::filesystem::current_path(), models = folder_ / "models";
  std::filesystem::create_directory(models);
  std::filesystem::copy(file_, models / "mine.safetensors");
  set_variable("RAYMELD_MODELS", models.string().c_str());
  const std::vector<std::string> names = list_models();
  for (const char* name : {"mine", "x4-fast", "x4-balanced"})
    EXPECT_EQ(std::ranges::count(names, name), 1) << name;
  EXPECT_TRUE(std::ranges::is_sorted(names));
  uint32_t count = 1;
  const char* some[2] = {};
  EXPECT_EQ(raymeld_list_models(&count, some), RAYMELD_SUCCESS);
  EXPECT_EQ(count, names.size());
  EXPECT_EQ(some[0], names[0]);
  EXPECT_EQ(some[1], nullptr);
  EXPECT_EQ(SharedModel("mine").info().scale, 2u);
  EXPECT_EQ(SharedModel("x4-fast").info().scale, 4u);
  // The folder hides installed models of the same name, a path is never a name, and a file hides a name.
  std::filesystem::copy(file_, models / "x4-fast.safetensors");
  EXPECT_EQ(SharedModel("x4-fast").info().scale, 2u);
  EXPECT_FAILURE(RAYMELD_ERROR_MODEL, SharedModel("their"), "no model 'their'",
                 "there are denoise-balanced, denoise-kpcn, mine,");
  EXPECT_FAILURE(RAYMELD_ERROR_MODEL, SharedModel("./mine"), "./mine", "no such file");
  EXPECT_FAILURE(RAYMELD_ERROR_MODEL, SharedModel("mine.safetensors"), "mine.safetensors", "no such file");
  std::filesystem::current_path(folder_.path());
  write_file("mine", "junk");
  EXPECT_FAILURE(RAYMELD_ERROR_MODEL, SharedModel("mine"), "mine");
  std::filesystem::current_path(before);
  set_variable("RAYMELD_MODELS", nullptr);
}

TEST_F(ApiTest, DevicesAreListedByIndex) {
  uint32_t count = 0;
  EXPECT_EQ(raymeld_list_devices(nullptr, nullptr), RAYMELD_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(raymeld_list_devices(&count, nullptr), RAYMELD_SUCCESS);
  const std::vector<DeviceInfo> devices = list_devices();
  ASSERT_EQ(count, devices.size());
  std::vector<const char*> names(count);
  EXPECT_EQ(raymeld_list_devices(&count, names.data()), RAYMELD_SUCCESS);
  for (const DeviceInfo& device : devices) EXPECT_EQ(names[device.index], device.name);
}

TEST_F(ApiTest, FeaturesAreWhatADeviceIsMadeWith) {
  const CallerDevice caller;
  const ExternalDevice& device = caller.external();
  const auto features = list_features(device.get_instance_proc_addr, device.instance, device.physical_device);
  ASSERT_EQ(features.size(), 8u);
  const uint32_t enabled = context_desc(device).enabled_features;
  uint32_t bits = 0;
  for (const raymeld_feature& feature : features) {
    EXPECT_EQ(feature.supported, (enabled & feature.bit) != 0) << feature.bit;
    bits |= feature.bit;
    EXPECT_GT(feature.member_count + feature.extension_count, 0u);
    for (uint32_t i = 0; i < feature.member_count; ++i)
      EXPECT_NE(std::strstr(feature.members[i], "::"), nullptr) << feature.members[i];
    for (uint32_t i = 0; i < feature.extension_count; ++i) {
      if (!feature.supported) continue;
      EXPECT_TRUE(has_extension(caller.vk(), device.physical_device, feature.extensions[i]));
    }
    EXPECT_GT(std::strlen(feature.without), 20u);
  }
  EXPECT_EQ(bits, 255u);
  uint32_t count = 1;
  raymeld_feature first[2] = {features[1], features[1]};
  EXPECT_EQ(raymeld_list_features(device.get_instance_proc_addr, device.instance, device.physical_device,
                                  &count, first),
            RAYMELD_SUCCESS);
  EXPECT_EQ(count, 8u);
  EXPECT_EQ(first[0].bit, features[0].bit);
  EXPECT_EQ(first[1].bit, features[1].bit);
  raymeld_context_desc desc = context_desc(device);
  desc.enabled_features = 1u << 30;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Context{desc}, "0x40000000");
}

TEST_F(ApiTest, ATuningSaysHowFarItIsAndKeepsWhatItHasWhenItIsStopped) {
  raymeld_context_desc on;
  const std::string folder = (folder_ / "tunings").string();
  on.cache_folder = "";
  const Context context(on);
  const SharedModel model(file_);
  raymeld_tune_desc desc;
  desc.height = desc_.height;
  desc.width = desc_.width;
  desc.precision = RAYMELD_PRECISION_FP32;
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, tune(context, model, desc), "no folder");
  desc.folder = folder.c_str();
  desc.width = 0;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, tune(context, model, desc), "0 x 6");
  desc.width = desc_.width;

  std::vector<float> shares;
  desc.user = &shares;
  desc.progress = [](void* user, float done) {
    auto& shares = *static_cast<std::vector<float>*>(user);
    shares.push_back(done);
    return VkBool32(shares.size() != 3);
  };
  EXPECT_FAILURE(RAYMELD_ERROR_CANCELLED, tune(context, model, desc), "cancelled");
  ASSERT_EQ(shares.size(), 3u);
  EXPECT_EQ(shares[0], 0);
  EXPECT_LT(shares[2], 1);
  const std::filesystem::path file = std::filesystem::directory_iterator(folder)->path();
  EXPECT_EQ(load_tuning(file).entries.size(), 2u);

  tune(context, model, desc);
  EXPECT_TRUE(std::is_sorted(shares.begin() + 3, shares.end()));
  EXPECT_EQ(shares.back(), 1);
  Tuning tuning = load_tuning(file);
  EXPECT_GT(tuning.entries.size(), 2u);
  EXPECT_EQ(tuning.device, gpu().info().name);
  EXPECT_EQ(tuning.driver, gpu().info().driver);

  // What is measured again takes the place of what was known, and nothing else is lost.
  const Conv2dShape other{.height = 3, .width = 3, .channels_in = 1, .channels_out = 1, .kernel = 1};
  for (auto& [shape, entry] : tuning.entries) entry.time_ms = 1e9;
  tuning.entries[other].time_ms = 1e9;
  save_tuning(file, tuning);
  desc.again = VK_TRUE;
  shares.assign(3, 0);
  tune(context, model, desc);
  EXPECT_EQ(shares.at(4), 1 / float(tuning.entries.size() - 1));
  for (const auto& [shape, entry] : load_tuning(file).entries)
    EXPECT_EQ(entry.time_ms == 1e9, shape == other);
  EXPECT_EQ(load_tuning(file).entries.size(), tuning.entries.size());
}

// The tunings say that 3x3 convolutions are fastest by F(2, 3), whose bits are no other kernel's, or
// directly.
TEST_F(ApiTest, AShippedTuningCountsWhereTheCacheHasNone) {
  if (!gpu().info().buffer_device_address) GTEST_SKIP() << "the device has one kernel only";
  const std::string by_winograd = (folder_ / "winograd").string(), by_direct = (folder_ / "direct").string();
  Tuning winograd, direct;
  for (const Conv2dShape& shape : shapes_to_tune(gpu(), Storage::kFloat32, Model(file_), {6, 9})) {
    direct.entries[shape] = {};
    if (shape.kernel == 3)
      winograd.entries[shape].kernel = {.algorithm = Algorithm::kWinograd, .tile = 2, .order = 0};
  }
  save_tuning(tuning_file(by_winograd, gpu(), Storage::kFloat32), winograd);
  save_tuning(tuning_file(by_direct, gpu(), Storage::kFloat32), direct);
  const auto fused = [&](const std::string& cache, const char* shipped, raymeld_kernels kernels) {
    raymeld_context_desc on;
    on.cache_folder = cache.c_str();
    on.tuning_folder = shipped;
    raymeld_fusion_desc desc = desc_;
    desc.precision = RAYMELD_PRECISION_FP32;
    desc.kernels = kernels;
    Fusion fusion(Context(on), SharedModel(file_), desc);
    return fuse(fusion, subject_).values;
  };
  const auto expected = fused("", nullptr, RAYMELD_KERNELS_DIRECT);
  EXPECT_FALSE(same_bits(fused(by_winograd, nullptr, RAYMELD_KERNELS_AUTO), expected));
  EXPECT_FALSE(same_bits(fused("", by_winograd.c_str(), RAYMELD_KERNELS_AUTO), expected));
  EXPECT_TRUE(same_bits(fused("", by_direct.c_str(), RAYMELD_KERNELS_AUTO), expected));
  EXPECT_TRUE(same_bits(fused(by_direct, by_winograd.c_str(), RAYMELD_KERNELS_AUTO), expected));
  // A file that is no tuning is as good as none.
  write_file(tuning_file(by_winograd, gpu(), Storage::kFloat32), "{}");
  EXPECT_TRUE(same_bits(fused(by_winograd, by_direct.c_str(), RAYMELD_KERNELS_AUTO), expected));
}

// Makes devices with the chains, under validation; raymeld then uses the features that were enabled.
TEST(Features, AnExtensionThatTwoNeedIsListedOnce) {
  const auto listed = extensions_of(RAYMELD_FEATURE_COOPERATIVE_MATRIX | RAYMELD_FEATURE_HALF_DOTS);
  const std::set<std::string> names(listed.begin(), listed.end());
  EXPECT_EQ(names.size(), listed.size());
  EXPECT_TRUE(names.contains(VK_KHR_SHADER_FLOAT16_INT8_EXTENSION_NAME));
}

TEST_F(ApiTest, FeaturesAreEnabledInTheCallersChain) {
  const CallerDevice caller;
  const ExternalDevice& external = caller.external();
  const auto enable = [&](VkPhysicalDeviceFeatures2& chain) {
    return enable_features(external.get_instance_proc_addr, external.instance, external.physical_device,
                           chain);
  };
  const uint32_t supported = context_desc(external).enabled_features & ~RAYMELD_FEATURE_COOPERATIVE_MATRIX;
  const uint32_t alone = supported & (RAYMELD_FEATURE_IMAGE_WRITES | RAYMELD_FEATURE_EXTERNAL_MEMORY_FD |
                                      RAYMELD_FEATURE_FLOAT_CONTROLS);
  const auto use = [&](VkPhysicalDeviceFeatures2& chain, const raymeld_enabled_features& enabled) {
    const float priority = 1;
    auto queue = vk_struct<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
    queue.queueFamilyIndex = external.queue_family;
    queue.queueCount = 1;
    queue.pQueuePriorities = &priority;
    auto info = vk_struct<VkDeviceCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, &chain);
    info.queueCreateInfoCount = 1;
    info.pQueueCreateInfos = &queue;
    info.enabledExtensionCount = enabled.extension_count;
    info.ppEnabledExtensionNames = enabled.extensions;
    ExternalDevice made = external;
    check(caller.vk().CreateDevice(made.physical_device, &info, nullptr, &made.device), "creating a device");
    caller.vk().GetDeviceQueue(made.device, made.queue_family, 0, &made.queue);
    raymeld_context_desc desc = context_desc(made);
    desc.enabled_features = enabled.bits;
    raymeld_fusion_desc fusion = desc_;
    if (enabled.bits & RAYMELD_FEATURE_STORAGE_16BIT) fusion.precision = RAYMELD_PRECISION_FP16;
    Fusion(Context(desc), SharedModel(file_), fusion);
    caller.vk().DestroyDevice(made.device, nullptr);
  };
  auto plain = vk_struct<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2);
  EXPECT_EQ(enable(plain).bits, alone);
  EXPECT_FALSE(plain.features.shaderInt64);  // buffer addresses also need a structure that the chain lacks
  EXPECT_EQ(plain.features.shaderStorageImageWriteWithoutFormat, external.image_writes);
  use(plain, enable(plain));

  // This chain has a structure for each feature, and a member that the caller has set.
  auto half = vk_struct<VkPhysicalDevice16BitStorageFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES);
  auto addresses = vk_struct<VkPhysicalDeviceBufferDeviceAddressFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES, &half);
  auto own = vk_struct<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &addresses);
  own.features.robustBufferAccess = VK_TRUE;
  const raymeld_enabled_features of_own = enable(own);
  EXPECT_EQ(of_own.bits, supported & ~RAYMELD_FEATURE_TIMELINE_SEMAPHORE);
  EXPECT_EQ(half.storageBuffer16BitAccess, external.storage_16bit);
  EXPECT_FALSE(half.uniformAndStorageBuffer16BitAccess);
  EXPECT_EQ(addresses.bufferDeviceAddress, external.buffer_device_address);
  EXPECT_EQ(own.features.shaderInt64, external.buffer_device_address);
  EXPECT_TRUE(own.features.robustBufferAccess);
  use(own, of_own);

  // This chain has the structures of Vulkan 1.1 and 1.2. The instance is too old to make a device with them.
  auto second =
      vk_struct<VkPhysicalDeviceVulkan12Features>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES);
  auto first = vk_struct<VkPhysicalDeviceVulkan11Features>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_FEATURES, &second);
  auto core = vk_struct<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &first);
  const raymeld_enabled_features of_core = enable(core);
  EXPECT_EQ(of_core.bits, supported);
  EXPECT_EQ(first.storageBuffer16BitAccess, external.storage_16bit);
  EXPECT_EQ(second.bufferDeviceAddress, external.buffer_device_address);
  EXPECT_EQ(second.timelineSemaphore, external.timeline_semaphore);
  EXPECT_FALSE(second.vulkanMemoryModel);

  core.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, enable(core), "sType");
}

// A caller that was compiled with an older structure has an array of shorter elements.
TEST_F(ApiTest, FeaturesAreWrittenAtTheStrideOfTheCaller) {
  const CallerDevice caller;
  const ExternalDevice& device = caller.external();
  const auto features = list_features(device.get_instance_proc_addr, device.instance, device.physical_device);
  constexpr size_t kOlder = offsetof(raymeld_feature, members);
  constexpr char kUntouched = 0x5a;
  std::vector<char> older((features.size() + 1) * kOlder, kUntouched);
  std::memcpy(older.data(), &kOlder, sizeof(kOlder));
  auto count = uint32_t(features.size());
  ASSERT_EQ(raymeld_list_features(device.get_instance_proc_addr, device.instance, device.physical_device,
                                  &count, reinterpret_cast<raymeld_feature*>(older.data())),
            RAYMELD_SUCCESS);
  for (size_t i = 0; i < features.size(); ++i) {
    raymeld_feature written;
    std::memcpy(static_cast<void*>(&written), older.data() + i * kOlder, kOlder);
    EXPECT_EQ(written.struct_size, kOlder) << i;
    EXPECT_EQ(written.bit, features[i].bit) << i;
    EXPECT_EQ(written.supported, features[i].supported) << i;
    EXPECT_EQ(written.extension_count, features[i].extension_count) << i;
    EXPECT_EQ(written.extensions, features[i].extensions) << i;
  }
  EXPECT_EQ(std::string(older.end() - kOlder, older.end()), std::string(kOlder, kUntouched));
}

// Counts the host's allocations.
struct Allocations {
  struct Block {
    size_t size;
    std::align_val_t alignment;
  };
  std::atomic<int> made{0}, alive{0};
  std::mutex mutex;
  std::map<void*, Block> blocks;

  void* allocate(size_t size, size_t alignment) {
    const Block block{size, std::align_val_t(alignment)};
    void* const address = ::operator new(block.size, block.alignment);
    const std::lock_guard lock(mutex);
    blocks[address] = block;
    ++made, ++alive;
    return address;
  }
  void free(void* address) {
    if (!address) return;
    const std::lock_guard lock(mutex);
    const auto block = blocks.extract(address);
    ASSERT_FALSE(block.empty());
    --alive;
    ::operator delete(address, block.mapped().alignment);
  }

  static VKAPI_ATTR void* VKAPI_CALL allocate(void* self, size_t size, size_t alignment,
                                              VkSystemAllocationScope) {
    return static_cast<Allocations*>(self)->allocate(size, alignment);
  }
  static VKAPI_ATTR void* VKAPI_CALL reallocate(void* self, void* block, size_t size, size_t alignment,
                                                VkSystemAllocationScope) {
    auto& all = *static_cast<Allocations*>(self);
    void* const larger = all.allocate(size, alignment);
    if (block) std::memcpy(larger, block, std::min(size, all.blocks.at(block).size));
    all.free(block);
    return larger;
  }
  static VKAPI_ATTR void VKAPI_CALL free(void* self, void* block) {
    static_cast<Allocations*>(self)->free(block);
  }
};

TEST_F(ApiTest, TheCallersAllocatorServesAllObjects) {
  const CallerDevice caller;
  Allocations allocations;
  {
    raymeld_context_desc desc = context_desc(caller.external());
    VkAllocationCallbacks callbacks{
        &allocations, Allocations::allocate, Allocations::reallocate, Allocations::free, nullptr, nullptr};
    desc.allocation_callbacks = &callbacks;
    const Context context(desc);
    callbacks = {};  // the context holds a copy
    Fusion fusion(context, SharedModel(file_), desc_);
    fuse(fusion, subject_);
    EXPECT_GT(allocations.made, 10);
    EXPECT_GT(allocations.alive, 10);
  }
  EXPECT_EQ(allocations.alive, 0);
}

TEST_F(ApiTest, TheCallersPipelineCacheTakesThePlaceOfTheFile) {
  const CallerDevice caller;
  const auto info = vk_struct<VkPipelineCacheCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO);
  VkPipelineCache cache = VK_NULL_HANDLE;
  check(caller.vk().CreatePipelineCache(caller.external().device, &info, nullptr, &cache),
        "creating a cache");
  raymeld_context_desc desc = context_desc(caller.external());
  const SharedModel model(file_);
  desc.pipeline_cache = cache;
  {
    Fusion fusion(Context(desc), model, desc_);
    fuse(fusion, subject_);
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "cache/raymeld"));
  // The cache is still the caller's to destroy, which validation checks.
  caller.vk().DestroyPipelineCache(caller.external().device, cache, nullptr);

  desc.pipeline_cache = VK_NULL_HANDLE;
  const std::string own = (folder_ / "own").string();
  desc.cache_folder = own.c_str();
  Fusion(Context(desc), model, desc_);
  EXPECT_FALSE(std::filesystem::is_empty(own));
  desc.cache_folder = "";
  Fusion(Context(desc), model, desc_);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "cache/raymeld"));
}

TEST_F(ApiTest, FusionsOfSeveralSizesShareTheWeights) {
  CallerDevice caller;
  const Context context(context_desc(caller.external()));
  const SharedModel model(file_);
  // Counts live allocations and not calls, as weights may take a copy on their way to the device.
  auto made_since = [before = 0]() mutable {
    const int now = interposed().alive.at("vkAllocateMemory");
    return now - std::exchange(before, now);
  };
  Fusion first(context, model, desc_);
  const int alone = made_since();
  raymeld_fusion_desc larger = desc_;
  larger.height *= 2;
  auto second = std::make_unique<Fusion>(context, model, larger);
  EXPECT_EQ(made_since(), alone - 1);
  larger.precision = RAYMELD_PRECISION_FP16;  // these weights are other bits
  Fusion third(context, model, larger);
  EXPECT_EQ(made_since(), alone);
  // It does not matter which fusion had the weights first.
  const std::vector<float> expected = fuse(first, subject_).values;
  Fusion fourth(context, model, desc_);
  first = Fusion(context, model, larger);
  second.reset();
  EXPECT_EQ(fuse(fourth, subject_).values, expected);
}

TEST_F(ApiTest, ActivationsMayLieInTheCallersMemory) {
  CallerDevice caller;
  const Context context(context_desc(caller.external()));
  const SharedModel model(file_);
  Fusion own(context, model, desc_);
  const std::vector<float> expected = fuse(own, subject_).values;
  caller.take_calls();
  const raymeld_memory_needs needs = memory_needs(context, model, desc_);
  EXPECT_FALSE(caller.take_calls().contains("vkAllocateMemory"));
  EXPECT_GT(needs.size_bytes, 0u);
  EXPECT_EQ(needs.history_size_bytes, 0u);

  // The memory lies in the middle of a larger block.
  const VkDeviceSize offset = 3 * needs.alignment_bytes, end = offset + needs.size_bytes;
  const CallerMemory memory(caller, end + 4096, needs.memory_type_bits, needs.device_address);
  if (memory.is_null()) GTEST_SKIP() << "activations may not lie in memory that the host sees";
  desc_.memory = memory.handle();
  desc_.memory_offset_bytes = offset;
  desc_.memory_size_bytes = needs.size_bytes;
  {
    Fusion fusion(context, model, desc_);
    EXPECT_EQ(fuse(fusion, subject_).values, expected);
    EXPECT_LT(fusion.info().memory_bytes + needs.size_bytes / 2, own.info().memory_bytes);
    EXPECT_TRUE(memory.is_untouched(0, offset));
    EXPECT_FALSE(memory.is_untouched(offset, end));
    EXPECT_TRUE(memory.is_untouched(end, end + 4096));
    std::ranges::fill(memory.bytes(), uint8_t{0x7f});  // nothing is kept between frames
    EXPECT_EQ(fuse(fusion, subject_).values, expected);
  }
  desc_.memory_size_bytes -= 1;
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(context, model, desc_), "caller's memory", "expected");
  desc_.memory_size_bytes += 1;
  desc_.memory_offset_bytes += 4;
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(context, model, desc_), "at a multiple of");
}

// Planning such sizes would take all of the host's memory.
TEST_F(ApiTest, AbsurdSizesAreRefusedBeforeTheyArePlanned) {
  const Context context;
  const SharedModel model(file_);
  for (const auto side : {&raymeld_fusion_desc::height, &raymeld_fusion_desc::width}) {
    for (const uint32_t pixels : {65537u, 4'000'000'000u, UINT32_MAX}) {
      raymeld_fusion_desc desc = desc_;
      desc.*side = pixels;
      const std::string told = std::to_string(pixels);
      EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Fusion(context, model, desc), told, "from 1 to 65536");
      EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, memory_needs(context, model, desc), told);
    }
  }
  Fusion fusion(context, model, desc_);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.prepare_size(4'000'000'000, 4'000'000'000),
                 "4000000000", "at most 9 x 6");
  desc_.height = desc_.width = 65536;  // the largest size takes tiles
  desc_.max_memory_bytes = 16 << 20;
  EXPECT_LT(memory_needs(context, model, desc_).size_bytes, desc_.max_memory_bytes);
}

TEST_F(ApiTest, WhatCannotBeMadeHasNoMemoryNeeds) {
  const CallerDevice caller(false);
  const Context context(context_desc(caller.external()));
  const SharedModel model(file_);
  desc_.precision = RAYMELD_PRECISION_FP16;
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(context, model, desc_), "16-bit storage");
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, memory_needs(context, model, desc_), "16-bit storage");
}

}  // namespace
}  // namespace raymeld::test
