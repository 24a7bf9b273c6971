#include "engine/device.h"

#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/buffer.h"
#include "engine/commands.h"
#include "engine/instance.h"
#include "error_of.h"
#include "gpu.h"
#include "layers/shaders.h"

namespace raymeld::test {
namespace {

std::vector<DeviceInfo> made_up_devices() {
  std::vector<DeviceInfo> devices(4);
  const char* names[] = {"llvmpipe (LLVM 15)", "Intel(R) UHD 770", "NVIDIA RTX 2000", "NVIDIA RTX 4000"};
  const char* types[] = {"CPU", "integrated GPU", "discrete GPU", "discrete GPU"};
  for (uint32_t i = 0; i < 4; ++i) {
    devices[i].index = i;
    devices[i].name = names[i];
    devices[i].type = types[i];
    devices[i].uuid = fmt::format("0000000{}-abcd-0000-0000-000000000000", i);
  }
  return devices;
}

TEST(SelectDevice, ByDefaultTheFirstOfTheBestType) {
  std::vector<DeviceInfo> devices = made_up_devices();
  EXPECT_EQ(select_device(devices, ""), 2u);
  devices.resize(2);
  EXPECT_EQ(select_device(devices, ""), 1u);
  devices.resize(1);
  EXPECT_EQ(select_device(devices, ""), 0u);
  devices[0].type = "other";
  EXPECT_EQ(select_device(devices, ""), 0u);
}

TEST(SelectDevice, ByIndexUuidAndPartOfTheName) {
  const std::vector<DeviceInfo> devices = made_up_devices();
  EXPECT_EQ(select_device(devices, "0"), 0u);
  EXPECT_EQ(select_device(devices, "3"), 3u);
  EXPECT_EQ(select_device(devices, "00000001-abcd-0000-0000-000000000000"), 1u);
  EXPECT_EQ(select_device(devices, "00000003-ABCD-0000-0000-000000000000"), 3u);
  EXPECT_EQ(select_device(devices, "LLVMPIPE"), 0u);
  EXPECT_EQ(select_device(devices, "rtx 4"), 3u);
}

TEST(SelectDevice, AmbiguousAndUnknownListTheDevices) {
  const std::vector<DeviceInfo> devices = made_up_devices();
  EXPECT_ERROR(select_device(devices, "nvidia"), "\"nvidia\" matches 2 devices", "0: llvmpipe",
               "3: NVIDIA RTX 4000", "00000002-abcd");
  EXPECT_ERROR(select_device(devices, "voodoo"), "\"voodoo\" matches 0 devices", "1: Intel(R) UHD 770");
  EXPECT_ERROR(select_device(devices, "4"), "device 4 does not exist", "3: NVIDIA RTX 4000");
  EXPECT_ERROR(select_device(devices, "99999"), "does not exist");
}

TEST(ChooseMatrix, TakesTheWidestOf16BitFactorsAnd32BitSums) {
  const auto matrix = [](uint32_t m, uint32_t n, uint32_t k, VkComponentTypeKHR factors,
                         VkComponentTypeKHR sums) {
    return VkCooperativeMatrixPropertiesKHR{VK_STRUCTURE_TYPE_COOPERATIVE_MATRIX_PROPERTIES_KHR,
                                            nullptr,
                                            m,
                                            n,
                                            k,
                                            factors,
                                            factors,
                                            sums,
                                            sums,
                                            VK_FALSE,
                                            VK_SCOPE_SUBGROUP_KHR};
  };
  constexpr auto kHalf = VK_COMPONENT_TYPE_FLOAT16_KHR, kFloat = VK_COMPONENT_TYPE_FLOAT32_KHR;
  std::vector<VkCooperativeMatrixPropertiesKHR> listed;
  EXPECT_EQ(choose_matrix(listed), nullptr);
  listed = {matrix(16, 16, 16, kHalf, kHalf), matrix(8, 8, 8, kFloat, kFloat)};
  EXPECT_EQ(choose_matrix(listed), nullptr);
  listed.push_back(matrix(8, 8, 8, kHalf, kFloat));
  EXPECT_EQ(choose_matrix(listed), &listed[2]);
  listed.push_back(matrix(16, 8, 16, kHalf, kFloat));
  EXPECT_EQ(choose_matrix(listed), &listed[3]);
  listed.push_back(matrix(16, 16, 16, kHalf, kFloat));
  EXPECT_EQ(choose_matrix(listed), &listed[4]);
  listed[4].scope = VkScopeKHR(2);  // workgroup scope
  EXPECT_EQ(choose_matrix(listed), &listed[3]);
}

VkPhysicalDeviceMemoryProperties memory_of(const std::vector<VkMemoryPropertyFlags>& types) {
  VkPhysicalDeviceMemoryProperties memory{};
  memory.memoryTypeCount = uint32_t(types.size());
  for (size_t i = 0; i < types.size(); ++i) memory.memoryTypes[i].propertyFlags = types[i];
  return memory;
}

// What the device reads and writes often should lie in its own memory, if the host sees a part of it.
TEST(MemoryType, FitsWhoReadsAndWrites) {
  constexpr VkMemoryPropertyFlags kLocal = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT,
                                  kHost = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT |
                                          VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                                  kCached = VK_MEMORY_PROPERTY_HOST_CACHED_BIT;
  const auto discrete = memory_of({kLocal, kHost, kHost | kCached, kLocal | kHost});
  EXPECT_EQ(memory_type(discrete, ~0u, Memory::kDevice), 0u);
  EXPECT_EQ(memory_type(discrete, ~0u, Memory::kUpload), 1u);
  EXPECT_EQ(memory_type(discrete, ~0u, Memory::kReadback), 2u);
  EXPECT_EQ(memory_type(discrete, ~0u, Memory::kShared), 3u);
  EXPECT_EQ(memory_type(discrete, 7, Memory::kShared), 1u);
  EXPECT_EQ(memory_type(discrete, 2, Memory::kDevice), std::nullopt);
  const auto unified = memory_of({kLocal | kHost | kCached});
  for (const Memory memory : {Memory::kDevice, Memory::kUpload, Memory::kReadback, Memory::kShared})
    EXPECT_EQ(memory_type(unified, ~0u, memory), 0u);
}

class DeviceTest : public GpuTest {};

TEST_F(DeviceTest, TheListHasTheDeviceInUse) {
  const std::vector<DeviceInfo> devices = list_devices();
  ASSERT_FALSE(devices.empty());
  for (uint32_t i = 0; i < devices.size(); ++i) {
    EXPECT_EQ(devices[i].index, i);
    EXPECT_FALSE(devices[i].name.empty());
    EXPECT_FALSE(devices[i].driver.empty());
    EXPECT_EQ(devices[i].uuid.size(), 36u);
    EXPECT_GE(devices[i].api_version, VK_API_VERSION_1_1);
    EXPECT_GT(devices[i].memory_bytes, 0u);
    EXPECT_GE(devices[i].max_storage_range_bytes, uint64_t{1} << 27);  // the least that Vulkan allows
    EXPECT_LE(devices[i].storage_alignment_bytes, 256u);
  }
  const DeviceInfo& used = gpu().info();
  EXPECT_EQ(devices.at(used.index).uuid, used.uuid);
}

TEST_F(DeviceTest, CreatedBySelector) {
  const std::string& uuid = gpu().info().uuid;
  EXPECT_EQ(Device::create({.selector = uuid, .validation = Validation::kNone})->info().uuid, uuid);
  EXPECT_ERROR(Device::create({.selector = "no such device", .validation = Validation::kNone}),
               "no such device", gpu().info().name);
}

// Vulkan's loader hides drivers that put Vulkan on top of another interface from programs that do not ask.
TEST_F(DeviceTest, PortableDriversAreListed) {
  std::ifstream maps("/proc/self/maps");
  std::string line, driver;
  while (driver.empty() && std::getline(maps, line)) {
    const bool is_driver = contains(line, "libvulkan_lvp.so") || contains(line, "libvk_swiftshader.so");
    if (is_driver) driver = line.substr(line.find('/'));
  }
  if (driver.empty()) GTEST_SKIP() << "the driver is neither lavapipe nor SwiftShader";
  const TemporaryDirectory folder;
  const nlohmann::json content{
      {"file_format_version", "1.0.1"},
      {"ICD", {{"library_path", driver}, {"api_version", "1.1.0"}, {"is_portability_driver", true}}}};
  write_file(folder / "driver.json", content.dump());
  const std::string file = (folder / "driver.json").string();
  const ProcessResult result = run_process(
      {RAYMELD_PROGRAM, "devices"},
      {.directory = folder.path(), .environment = {{"VK_DRIVER_FILES", file}, {"VK_ICD_FILENAMES", file}}});
  EXPECT_EQ(result.exit_status, 0) << result.err;
  EXPECT_TRUE(contains(result.out, gpu().info().name)) << result.out;
}

// Tests that validation reports any misuse, synchronization included, as all tests rely on it.
class Validated : public testing::Test {
 protected:
  std::unique_ptr<Device> make_device(Validation validation = Validation::kSynchronization) {
    // A layer's message about its own settings reports no misuse.
    const auto keep = [this](const std::string& message) {
      if (!contains(message, "adjusting settings")) messages_.push_back(message);
    };
    return Device::create({.selector = {}, .validation = validation, .on_message = keep});
  }
  void expect_none() const { EXPECT_TRUE(messages_.empty()) << messages_.front(); }
  void expect_one_with(const std::string& text) const {
    const auto has_text = [&](const std::string& message) { return contains(message, text); };
    EXPECT_TRUE(std::ranges::any_of(messages_, has_text)) << fmt::format("{}", fmt::join(messages_, "\n"));
  }

 private:
  std::vector<std::string> messages_;
};

TEST_F(Validated, MisuseIsReported) {
  const std::unique_ptr<Device> device = make_device();
  const Buffer a(*device, 1024, Memory::kDevice, "a"), b(*device, 1024, Memory::kDevice, "b");
  const VkBufferCopy all{0, 0, 1024};
  const VulkanFunctions& vk = device->vk();
  Commands pool(*device);
  const VkCommandBuffer commands = pool.begin("hazard");
  vk.CmdCopyBuffer(commands, a.handle(), b.handle(), 1, &all);
  expect_none();
  vk.CmdCopyBuffer(commands, b.handle(), a.handle(), 1, &all);  // reads b without a barrier
  pool.end(commands);
  expect_one_with("SYNC-HAZARD");
}

// A graph places no barrier between accesses to different images; here both slots hold one image.
TEST_F(Validated, AMissingBarrierBetweenDispatchesIsReported) {
  const std::unique_ptr<Device> device = make_device();
  Graph graph(Storage::kFloat32, false, true);
  const Tensor in = graph.input("in", {4, 4, 3}), out = graph.tensor("out", {4, 4, 3});
  decode(graph, "decode", in, {});
  encode(graph, "encode", kHrlsSlot, out, std::vector<EncodedChannel>(3), Transfer::kLinear, 1);
  graph.plan();
  PipelineCache cache(*device, {});
  Program program(*device, graph, cache, 1);
  const FrameImage image(*device, Shape{4, 4, 3});
  FrameBindings frame = image.frame(kHrlsSlot);
  frame[kFusedSlot] = image.binding();
  program.bind(0, frame);
  Commands pool(*device);
  const VkCommandBuffer commands = pool.begin("hazard");
  program.record(commands, 0, 0, 1);
  expect_none();
  const VkCommandBuffer both = pool.begin("hazard");
  program.record(both, 0, 0, 2);
  expect_one_with("READ_AFTER_WRITE");
}

// Records a pass over small tensors with the sizes of large ones.
TEST_F(Validated, AccessesBeyondABindingAreReported) {
  const std::unique_ptr<Device> device = make_device(Validation::kGpuAssisted);
  Graph large(Storage::kFloat32), small(Storage::kFloat32);
  pool(large, "pool", large.input("in", {128, 128, 9}), large.tensor("out", {64, 64, 9}));
  const Tensor in = small.input("in", {8, 8, 9}), out = small.tensor("out", {4, 4, 9});
  Pass pass = large.passes().front();
  pass.bindings = {read_binding(in), read_binding(in), read_binding(in), write_binding(out)};
  small.add(std::move(pass));
  small.plan();
  PipelineCache cache(*device, {});
  Program program(*device, small, cache, 1);
  Commands pool(*device);
  const VkCommandBuffer commands = pool.begin("beyond");
  program.record(commands, 0, 0, 1);
  pool.end(commands);
  expect_none();
  device->submit_and_wait(commands);
  expect_one_with("out of bounds");
}

// Objects that a test does not destroy are reported when the shared device is destroyed.
TEST_F(Validated, WhatIsLeftBehindIsReportedAtTheDevicesEnd) {
  std::unique_ptr<Device> device = make_device();
  auto info = vk_struct<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO);
  info.size = 16;
  info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
  VkBuffer buffer = VK_NULL_HANDLE;
  check(device->vk().CreateBuffer(device->handle(), &info, nullptr, &buffer), "creating a buffer");
  expect_none();
  device.reset();
  expect_one_with("not been destroyed");
}

TEST_F(DeviceTest, AnImpossibleBufferIsAnErrorThatNamesIt) {
  EXPECT_ERROR(Buffer(gpu(), gpu().info().max_allocation_bytes + 4, Memory::kDevice, "the moon"), "the moon",
               "MiB", gpu().info().name);
}

}  // namespace
}  // namespace raymeld::test
