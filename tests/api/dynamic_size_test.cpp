// Tests frames whose size changes while a program runs, with the memory and the pipelines of the largest.
#include <gtest/gtest.h>

#include <algorithm>

#include "api_subject.h"
#include "error_of.h"
#include "fusion/tuner.h"

namespace raymeld::test {
namespace {

constexpr TileSize kMost{22, 30};

Subject subject_of(const reference::Architecture& architecture, TileSize size, uint64_t seed) {
  return make_subject(architecture, int(size.height), int(size.width), seed);
}

class DynamicSizeTest : public testing::Test {
 protected:
  void use(const reference::Architecture& architecture) {
    const Subject most = subject_of(architecture, kMost, 1);
    write_model(file_, architecture, most.weights);
    weights_ = most.weights;
    architecture_ = architecture;
  }

  TemporaryDirectory folder_;
  std::string file_ = (folder_ / "model.safetensors").string();
  reference::Architecture architecture_;
  reference::Weights weights_;
};

// Holds a frame on the device and records its fusion.
struct Recorded {
  Subject subject;
  FrameImage lrhs, hrls, fused;
  Recorded(const Device& device, Subject of)
      : subject(std::move(of)),
        lrhs(device, subject.lrhs),
        hrls(device, subject.hrls),
        fused(device, Shape{uint32_t(subject.hrls.h), uint32_t(subject.hrls.w), 3}) {}

  TileSize size() const { return {uint32_t(subject.lrhs.h), uint32_t(subject.lrhs.w)}; }
  void record(Fusion& fusion, VkCommandBuffer commands) const {
    std::array<raymeld_image, 3> images;
    std::ranges::transform(std::array{&lrhs, &hrls, &fused}, images.begin(), [](const FrameImage* image) {
      raymeld_image at;
      at.buffer = image->view().buffer;
      return at;
    });
    raymeld_frame frame;
    frame.lrhs = &images[0];
    frame.hrls = &images[1];
    frame.fused = &images[2];
    frame.height = size().height;
    frame.width = size().width;
    fusion.record(commands, frame);
  }
};

TEST_F(DynamicSizeTest, EverySizeHasTheBitsOfAFusionMadeForIt) {
  struct Case {
    reference::Architecture architecture;
    raymeld_precision precision = RAYMELD_PRECISION_FP32;
    raymeld_kernels kernels = RAYMELD_KERNELS_AUTO;
  };
  const Case cases[] = {
      {.architecture = small_architecture(2)},
      {.architecture = guided_architecture(2),
       .precision = RAYMELD_PRECISION_FP16,
       .kernels = RAYMELD_KERNELS_DIRECT},
      {.architecture = unshuffled_architecture(2)},
      {.architecture = pyramid_architecture(2)},
  };
  for (const Case& at : cases) {
    use(at.architecture);
    CallerDevice caller;
    const std::unique_ptr<Device> device = Device::wrap(caller.external());
    const Context context(context_desc(caller.external()));
    const SharedModel model(file_);
    raymeld_fusion_desc desc;
    desc.height = kMost.height;
    desc.width = kMost.width;
    desc.precision = at.precision;
    desc.kernels = at.kernels;
    Fusion fusion(context, model, desc);
    const std::array<TileSize, 5> sizes{{{22, 30}, {11, 16}, {22, 8}, {8, 30}, {16, 14}}};
    caller.take_calls();
    for (const TileSize size : sizes) fusion.prepare_size(size.height, size.width);
    const auto made = caller.take_calls();
    // The coarse levels of a pyramid have odd widths even here: see below.
    EXPECT_EQ(made.contains("vkCreateComputePipelines"), at.architecture.is_pyramid());
    EXPECT_EQ(made.contains("vkAllocateMemory"), false);
    EXPECT_TRUE(made.contains("vkAllocateDescriptorSets"));
    // Rows of odd widths cannot be read in pairs.
    fusion.prepare_size(9, 13);

    // There are more frames than may be in flight, and the size changes from each to the next.
    std::vector<Recorded> frames;
    for (uint64_t i = 0; i < 2 * sizes.size() + 1; ++i) {
      const TileSize size = i == 2 * sizes.size() ? TileSize{9, 13} : sizes[i % sizes.size()];
      Subject subject = subject_of(at.architecture, size, 10 + i);
      frames.emplace_back(*device, std::move(subject));
    }
    for (size_t first = 0; first < frames.size(); first += kFramesInFlight) {
      const size_t last = std::min(first + kFramesInFlight, frames.size());
      Commands pool(*device);
      for (size_t i = first; i < last; ++i) {
        const VkCommandBuffer commands = pool.begin("frame");
        caller.take_calls();
        frames[i].record(fusion, commands);
        EXPECT_TRUE(caller.take_calls().empty());
        pool.end(commands);
        auto submit = vk_struct<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
        submit.commandBufferCount = 1;
        submit.pCommandBuffers = &commands;
        check(caller.vk().QueueSubmit(device->queue(), 1, &submit, VK_NULL_HANDLE), "submitting");
      }
      check(caller.vk().DeviceWaitIdle(device->handle()), "waiting");
    }
    EXPECT_EQ(fusion.take_status().not_finite, 0u);
    for (const Recorded& frame : frames) {
      SCOPED_TRACE(fmt::format("{} x {}", frame.size().width, frame.size().height));
      desc.height = frame.size().height;
      desc.width = frame.size().width;
      Fusion own(context, model, desc);
      EXPECT_TRUE(same_bits(floats(frame.fused.read()), fuse(own, frame.subject).values));
    }
  }
}

TEST_F(DynamicSizeTest, CountsOfAllSizesAreTaken) {
  use(small_architecture(2));
  for (double& bias : weights_.at("rec").bias) bias = 3e38;
  for (double& weight : weights_.at("rec").weight) weight = 3e38;
  write_model(file_, architecture_, weights_);
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  raymeld_fusion_desc desc;
  desc.height = kMost.height;
  desc.width = kMost.width;
  desc.precision = RAYMELD_PRECISION_FP32;
  desc.kernels = RAYMELD_KERNELS_DIRECT;
  Fusion fusion(Context(context_desc(caller.external())), SharedModel(file_), desc);
  fusion.prepare_size(8, 9);
  const Recorded frame(*device, subject_of(architecture_, {8, 9}, 2));
  Commands pool(*device);
  const VkCommandBuffer commands = pool.begin("frame");
  frame.record(fusion, commands);
  pool.end(commands);
  device->submit_and_wait(commands);
  EXPECT_GT(fusion.take_status().not_finite, 0u);
  EXPECT_EQ(fusion.take_status().not_finite, 0u);
}

TEST_F(DynamicSizeTest, OtherSizesAreRefused) {
  use(small_architecture(2));
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Context context(context_desc(caller.external()));
  const SharedModel model(file_);
  raymeld_fusion_desc desc;
  desc.height = kMost.height;
  desc.width = kMost.width;
  desc.kernels = RAYMELD_KERNELS_DIRECT;
  Fusion fusion(context, model, desc);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.prepare_size(23, 30), "30 x 23", "at most 30 x 22");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.prepare_size(0, 30), "30 x 0");
  const Recorded frame(*device, subject_of(architecture_, {8, 9}, 3));
  Commands pool(*device);
  const VkCommandBuffer commands = pool.begin("frame");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, frame.record(fusion, commands), "9 x 8",
                 "raymeld_prepare_size");
  pool.end(commands);

  desc.height = desc.width = 64;
  desc.max_memory_bytes = fusion.info().memory_bytes;
  Fusion tiled(context, model, desc);
  ASSERT_LT(tiled.info().tile_width, 64u);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, tiled.prepare_size(8, 9), "tiles");
}

// Bands, the rows of tensors that are stored and the lifetimes of tensors depend on the size. Any must fit.
TEST_F(DynamicSizeTest, AnySizeFitsInTheMemoryOfALargerOne) {
  DeviceInfo device;
  device.memory_bytes = device.max_allocation_bytes = device.max_storage_range_bytes = uint64_t{1} << 40;
  device.max_groups = {UINT32_MAX, UINT32_MAX, UINT32_MAX};
  device.buffer_device_address = device.storage_16bit = true;
  for (const uint32_t band : {32u, 256u, 1u << 16}) {
    for (const reference::Architecture& architecture :
         {small_architecture(4), guided_architecture(2), unshuffled_architecture(4), pyramid_architecture(4),
          kpcn_architecture()}) {
      use(architecture);
      const Model model(file_);
      const Conv2dChoice choose = [&](const Conv2dShape& shape) {
        return shape.kernel == 1
                   ? Conv2dKernel{.algorithm = Algorithm::kPointwise, .band = band}
                   : Conv2dKernel{.algorithm = Algorithm::kWinograd, .tile = shape.most_tile, .band = band};
      };
      FuserOptions options;
      options.kernels = {.addressed = true, .vector = 8, .conv2d = choose};
      const FusePlan plan = plan_fusion(model, 50, 67, device, options);
      for (uint32_t height = 1; height <= 50; height += 7) {
        for (uint32_t width = 1; width <= 67; width += 3) {
          const Graph graph = graph_within(plan, model, {height, width}, options);
          EXPECT_EQ(graph.activation_bytes(), plan.graph.activation_bytes());
          EXPECT_TRUE(has_guards(graph));
          EXPECT_LE(graph.passes().size(), plan.graph.passes().size());
        }
      }
    }
  }
}

TEST_F(DynamicSizeTest, AnotherNetworkDoesNotFit) {
  Graph larger(Storage::kFloat32), other(Storage::kFloat32), wider(Storage::kFloat32);
  larger.input("x", {8, 8, 3});
  other.input("y", {4, 4, 3});
  wider.input("x", {8, 9, 64});
  larger.plan();
  EXPECT_ERROR(other.plan_within(larger), "not of the same network for smaller frames");
  EXPECT_ERROR(wider.plan_within(larger), "not of the same network for smaller frames");
}

}  // namespace
}  // namespace raymeld::test
