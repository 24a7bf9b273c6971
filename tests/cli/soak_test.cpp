// Fuses many frames in one process: memory does not grow, and bits do not drift.
#include <gtest/gtest.h>
#include <malloc.h>

#include <array>
#include <cstdlib>
#include <cstring>

#include "caller_device.h"
#include "faults.h"
#include "fusion/fuser.h"
#include "io/layers_from_exr.h"
#include "subject.h"

namespace raymeld::test {
namespace {

constexpr int kFrames = 200, kWarmUp = 50;

// Returns the bytes that malloc() has handed out to raymeld and the driver and not got back. Unlike resident
// memory, they depend on no other process.
uint64_t heap_bytes() {
  const struct mallinfo2 info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

struct Input {
  Image lrhs, hrls;
};

// Returns the top-left pixels of `image`, which has at least as many.
Image cropped(const Image& image, int width, int height) {
  Image result(width, height, image.channels);
  for (int c = 0; c < image.channels; ++c)
    for (int y = 0; y < height; ++y)
      std::copy_n(image.plane(c) + size_t(y) * size_t(image.width), width, &result.at(c, y, 0));
  return result;
}

// RAYMELD_SOAK_MODEL=FILE takes that model and 256x256 pixels of data/ in place of a tiny model and noise.
struct Workload {
  Workload() {
    const char* file = std::getenv("RAYMELD_SOAK_MODEL");
    model = std::make_unique<Model>(file ? file : source_path("tests/golden/pyramid-x4.safetensors"));
    const Architecture& a = model->architecture();
    const int scale = int(a.scale), side = file ? 256 / scale : 11;
    if (file) {
      ExrFile lrhs(source_path(fmt::format("data/lrhs-x{}.exr", scale))), hrls(source_path("data/hrls.exr"));
      inputs[0] = {
          cropped(load_layers(lrhs, map_layers(lrhs), std::array<std::string, 1>{"color"}), side, side),
          cropped(load_layers(hrls, map_layers(hrls), a.hrls_layers), side * scale, side * scale)};
    } else {
      const int channels = 3 * int(a.hrls_layers.size());
      inputs[0] = {image_of(random_planes(3, side, side, Fill::kUniform, 1)),
                   image_of(random_planes(channels, side * scale, side * scale, Fill::kUniform, 2))};
    }
    inputs[1] = inputs[0];
    for (float& value : inputs[1].lrhs.data) value *= 0.5f;
  }

  std::unique_ptr<Model> model;
  std::array<Input, 2> inputs;
};

// Fuses without validation, whose own memory grows, unless the given device has it. record() passes its
// images in mapped buffers.
class Soak {
 public:
  explicit Soak(const Workload& work, std::unique_ptr<Device> device = Device::create())
      : device_(std::move(device)),
        work_(work),
        fuser_(*device_, *work.model, uint32_t(work.inputs[0].lrhs.height),
               uint32_t(work.inputs[0].lrhs.width), {.exposure = 1}, folder_.path()),
        lrhs_(*device_, bytes(work.inputs[0].lrhs), Memory::kUpload, "lrhs"),
        hrls_(*device_, bytes(work.inputs[0].hrls), Memory::kUpload, "hrls"),
        result_(work.inputs[0].hrls.width, work.inputs[0].hrls.height, 3),
        fused_(*device_, bytes(result_), Memory::kReadback, "fused") {}

  const std::vector<float>& fuse(int which) {
    fuser_.fuse(work_.inputs[which].lrhs, work_.inputs[which].hrls, result_);
    return result_.data;
  }

  const std::vector<float>& record(int which) {
    const Input& input = work_.inputs[which];
    std::memcpy(lrhs_.mapped(), input.lrhs.data.data(), bytes(input.lrhs));
    std::memcpy(hrls_.mapped(), input.hrls.data.data(), bytes(input.hrls));
    Commands pool(*device_);
    const VkCommandBuffer commands = pool.begin("frame");
    fuser_.record(commands, view(lrhs_, input.lrhs), view(hrls_, input.hrls), view(fused_, result_));
    make_visible_to_host(commands);
    pool.end(commands);
    device_->submit_and_wait(commands);
    fused_.invalidate();
    std::memcpy(result_.data.data(), fused_.mapped(), bytes(result_));
    return result_.data;
  }

 private:
  static uint64_t bytes(const Image& image) { return image.data.size() * sizeof(float); }

  static FrameBuffer view(const Buffer& buffer, const Image& image) {
    return {buffer.handle(), 0, 1, uint32_t(image.width), uint32_t(image.plane_size())};
  }

  void make_visible_to_host(VkCommandBuffer commands) const {
    auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
    barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
    device_->vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT,
                                     VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0, nullptr, 0, nullptr);
  }

  TemporaryDirectory folder_;
  std::unique_ptr<Device> device_;
  const Workload& work_;
  Fuser fuser_;
  Buffer lrhs_, hrls_;
  Image result_;
  Buffer fused_;
};

TEST(Soak, FramesNeitherGrowNorDrift) {
  const Workload work;
  Soak soak(work);
  const std::array expected{soak.fuse(0), soak.fuse(1)};
  ASSERT_FALSE(same_bits(expected[0], expected[1]));
  uint64_t settled_bytes = 0;
  for (int frame = 0; frame < kFrames; ++frame) {
    const int which = frame / 2 % 2;
    ASSERT_TRUE(same_bits(frame % 2 ? soak.record(which) : soak.fuse(which), expected[which])) << frame;
    if (frame == kWarmUp) settled_bytes = heap_bytes();
  }
  const uint64_t end_bytes = heap_bytes();
  fmt::print("heap: {} bytes after {} frames, {} after {}\n", settled_bytes, kWarmUp, end_bytes, kFrames);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // their malloc() reports no sizes
  ASSERT_GT(settled_bytes, 0u);
  constexpr uint64_t kJitterBytes = 1024;  // the driver's own; a leak of 8 bytes a frame is more
  EXPECT_LE(end_bytes, settled_bytes + kJitterBytes);
#endif
}

// Every object of Vulkan is counted.
TEST(Soak, FramesLeaveNoObjectsOfVulkan) {
  const Workload work;
  const CallerDevice caller;
  Soak soak(work, Device::wrap(caller.external()));
  std::map<std::string, int> settled;
  for (int frame = 0; frame < 12; ++frame) {
    frame % 2 ? soak.record(0) : soak.fuse(0);
    if (frame == 3) settled = interposed().alive;
  }
  EXPECT_GT(settled["vkAllocateMemory"], 0);
  EXPECT_EQ(interposed().alive, settled);
}

}  // namespace
}  // namespace raymeld::test
