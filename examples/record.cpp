// Records raymeld into a command buffer on a Vulkan device of this program's own: record MODEL fuses two flat
// images in buffers and prints a pixel.
#include <vulkan/vulkan.h>

#include <algorithm>
#include <cstdio>
#include <raymeld/raymeld.hpp>
#include <stdexcept>

namespace {

void check(VkResult result, const char* what) {
  if (result < 0) throw std::runtime_error(std::string(what) + " failed");
}

// Makes a device of the first listed one and its first queue family, which computes on every known driver.
raymeld_context_desc make_gpu() {
  raymeld_context_desc gpu{.get_instance_proc_addr = vkGetInstanceProcAddr};
  const VkApplicationInfo app{.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_1};
  const VkInstanceCreateInfo instance{.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                      .pApplicationInfo = &app};
  check(vkCreateInstance(&instance, nullptr, &gpu.instance), "vkCreateInstance");
  uint32_t count = 1;
  check(vkEnumeratePhysicalDevices(gpu.instance, &count, &gpu.physical_device), "vkEnumeratePhysicalDevices");
  const float priority = 1;
  const VkDeviceQueueCreateInfo queue{
      .sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, .queueCount = 1, .pQueuePriorities = &priority};
  // These features make raymeld faster; those that the device has are enabled.
  VkPhysicalDeviceBufferDeviceAddressFeatures addresses{
      .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES};
  VkPhysicalDevice16BitStorageFeatures half{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES,
                                            .pNext = &addresses};
  VkPhysicalDeviceFeatures2 features{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &half};
  const auto enabled =
      raymeld::enable_features(vkGetInstanceProcAddr, gpu.instance, gpu.physical_device, features);
  gpu.enabled_features = enabled.bits;
  const VkDeviceCreateInfo device{.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                  .pNext = &features,
                                  .queueCreateInfoCount = 1,
                                  .pQueueCreateInfos = &queue,
                                  .enabledExtensionCount = enabled.extension_count,
                                  .ppEnabledExtensionNames = enabled.extensions};
  check(vkCreateDevice(gpu.physical_device, &device, nullptr, &gpu.device), "vkCreateDevice");
  vkGetDeviceQueue(gpu.device, 0, 0, &gpu.queue);
  return gpu;
}

struct Buffer {
  VkBuffer handle;
  float* values;
};

// Makes a storage buffer of `count` floats in memory that the host sees, each of them `value`.
Buffer make_buffer(const raymeld_context_desc& gpu, size_t count, float value) {
  Buffer buffer;
  const VkBufferCreateInfo info{.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                .size = count * sizeof(float),
                                .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT};
  check(vkCreateBuffer(gpu.device, &info, nullptr, &buffer.handle), "vkCreateBuffer");
  VkMemoryRequirements needs;
  vkGetBufferMemoryRequirements(gpu.device, buffer.handle, &needs);
  VkPhysicalDeviceMemoryProperties has;
  vkGetPhysicalDeviceMemoryProperties(gpu.physical_device, &has);
  constexpr VkFlags kHost = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  uint32_t type = 0;
  while (!(needs.memoryTypeBits >> type & 1) || (has.memoryTypes[type].propertyFlags & kHost) != kHost)
    ++type;
  const VkMemoryAllocateInfo allocation{
      .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = needs.size, .memoryTypeIndex = type};
  VkDeviceMemory memory;
  void* mapped;
  check(vkAllocateMemory(gpu.device, &allocation, nullptr, &memory), "vkAllocateMemory");
  check(vkBindBufferMemory(gpu.device, buffer.handle, memory, 0), "vkBindBufferMemory");
  check(vkMapMemory(gpu.device, memory, 0, VK_WHOLE_SIZE, 0, &mapped), "vkMapMemory");
  buffer.values = static_cast<float*>(mapped);
  std::fill_n(buffer.values, count, value);
  return buffer;
}

void fuse(const raymeld_context_desc& gpu, const char* model_file) {
  const uint32_t height = 32, width = 48;  // the size of LRHS in pixels
  const raymeld::Context context(gpu);
  const raymeld::SharedModel model(model_file);
  raymeld::Fusion fusion(context, model, {.height = height, .width = width, .compute_variance = VK_TRUE});
  const size_t pixels = size_t{height} * width, s = fusion.info().scale, layers = fusion.layers().size();
  const Buffer small = make_buffer(gpu, 3 * pixels, 0.5f),
               large = make_buffer(gpu, 3 * layers * s * s * pixels, 0.5f),
               output = make_buffer(gpu, 3 * s * s * pixels, 0);
  const raymeld_image lrhs{.buffer = small.handle}, hrls{.buffer = large.handle},
      fused{.buffer = output.handle};

  const VkCommandPoolCreateInfo pool_info{.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
  VkCommandPool pool;
  check(vkCreateCommandPool(gpu.device, &pool_info, nullptr, &pool), "vkCreateCommandPool");
  const VkCommandBufferAllocateInfo info{
      .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandPool = pool, .commandBufferCount = 1};
  VkCommandBuffer commands;
  check(vkAllocateCommandBuffers(gpu.device, &info, &commands), "vkAllocateCommandBuffers");
  const VkCommandBufferBeginInfo begin{.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
  check(vkBeginCommandBuffer(commands, &begin), "vkBeginCommandBuffer");
  fusion.record(commands, {.lrhs = &lrhs, .hrls = &hrls, .fused = &fused});
  check(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
  const VkSubmitInfo submit{
      .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
  check(vkQueueSubmit(gpu.queue, 1, &submit, VK_NULL_HANDLE), "vkQueueSubmit");
  check(vkQueueWaitIdle(gpu.queue), "vkQueueWaitIdle");
  std::printf("%zu x %zu pixels, the first of which is %g %g %g\n", s * width, s * height, output.values[0],
              output.values[s * s * pixels], output.values[2 * s * s * pixels]);
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw std::runtime_error("usage: record MODEL");
  fuse(make_gpu(), argv[1]);  // the end of the process frees all Vulkan objects
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
