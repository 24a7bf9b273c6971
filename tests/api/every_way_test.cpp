// Fuses, records and submits on a device with all of its features and without each of them, under validation.
// It looks at no value: scripts/test-gpus runs it on drivers of GPUs that are not there.
#include <gtest/gtest.h>

#include "api_subject.h"
#include "caller_image.h"
#include "faults.h"

namespace raymeld::test {
namespace {

constexpr uint32_t kHeight = 12, kWidth = 18;

struct Features {
  const char* name;
  bool storage_16bit = true, addresses = true, matrices = true, half_dots = true, image_writes = true,
       float_controls = true, timelines = true, external_memory = true;
};

class EveryWay : public testing::TestWithParam<Features> {
 protected:
  EveryWay() {
    set_cache_home(folder_ / "cache");
    write_model(file_, subject_.architecture, subject_.weights);
    ExternalDevice external = caller_.external();
    external.half_dots &= GetParam().half_dots;
    external.image_writes &= GetParam().image_writes;
    external.float_controls &= GetParam().float_controls;
    external.timeline_semaphore &= GetParam().timelines;
    external.external_memory_fd &= GetParam().external_memory;
    device_ = Device::wrap(external);
    context_.emplace(context_desc(external));
    model_.emplace(file_);
  }

  Fusion make(const raymeld_fusion_desc& desc) const { return Fusion(*context_, *model_, desc); }
  // Leaves out what the device was not given.
  bool has_images() const { return device_->info().image_writes; }

  void fuse_on_host(const raymeld_fusion_desc& desc) {
    Fusion fusion = make(desc);
    const uint32_t pixels = desc.height * desc.width, full = 4 * pixels;
    std::vector<float> lrhs(3 * pixels, 0.5f), hrls(3 * fusion.info().layer_count * full, 0.5f),
        fused(3 * full);
    for (int frame = 0; frame < 2; ++frame) fusion.fuse(lrhs.data(), hrls.data(), fused.data());
  }

  TemporaryDirectory folder_;
  std::string file_ = (folder_ / "model.safetensors").string();
  Subject subject_ = make_subject(guided_architecture(2), int(kHeight), int(kWidth), 1);
  CallerDevice caller_{GetParam().storage_16bit, GetParam().addresses, GetParam().matrices};
  std::unique_ptr<Device> device_;
  std::optional<Context> context_;
  std::optional<SharedModel> model_;
};

TEST_P(EveryWay, OnTheHost) {
  raymeld_fusion_desc desc = fusion_desc(subject_);
  fuse_on_host(desc);
  desc.precision = RAYMELD_PRECISION_FP32;
  fuse_on_host(desc);
  desc.kernels = RAYMELD_KERNELS_DIRECT;
  fuse_on_host(desc);
  desc.height = 64;
  desc.width = 128;
  desc.max_memory_bytes = make(desc).info().memory_bytes / 4 * 3;
  ASSERT_LT(make(desc).info().tile_width, 128u);
  fuse_on_host(desc);
  desc = fusion_desc(subject_);
  desc.skip_unchanged = VK_TRUE;
  fuse_on_host(desc);
}

TEST_P(EveryWay, RecordedAndSubmittedInTwoSizes) {
  raymeld_fusion_desc desc = fusion_desc(subject_);
  Fusion fusion = make(desc);
  fusion.prepare_size(kHeight - 1, kWidth - 1);
  const FrameImage lrhs(*device_, subject_.lrhs), hrls(*device_, subject_.hrls);
  std::vector<std::unique_ptr<FrameImage>> results;
  const raymeld_image in[] = {image_at(lrhs), image_at(hrls)};
  Commands pool(*device_);
  for (uint32_t i = 0; i < 2 * fusion.info().frames_in_flight + 1; ++i) {
    results.push_back(std::make_unique<FrameImage>(*device_, Shape{2 * kHeight, 2 * kWidth, 3}));
    const raymeld_image fused = image_at(*results.back());
    raymeld_frame frame;
    frame.lrhs = &in[0];
    frame.hrls = &in[1];
    frame.fused = &fused;
    frame.height = kHeight - i % 2;
    frame.width = kWidth - i % 2;
    if (i > 0) {
      fusion.submit(frame);
      continue;
    }
    const VkCommandBuffer commands = pool.begin("frame");
    fusion.record(commands, frame);
    pool.end(commands);
    device_->submit_and_wait(commands);
  }
  fusion.take_status();
}

TEST_P(EveryWay, FromImagesToAnImage) {
  raymeld_fusion_desc desc = fusion_desc(subject_);
  desc.input_images = VK_TRUE;
  desc.output_image = has_images();
  Fusion fusion = make(desc);
  std::vector<std::unique_ptr<CallerImage>> images;
  const auto view = [&](uint32_t height, uint32_t width, VkImageUsageFlags usage) {
    images.push_back(
        std::make_unique<CallerImage>(*device_, VK_FORMAT_R32G32B32A32_SFLOAT, width, height, usage));
    images.back()->write(std::vector<std::byte>(size_t{16} * width * height), VK_IMAGE_LAYOUT_GENERAL);
    raymeld_image at;
    at.view = images.back()->view();
    return at;
  };
  const raymeld_image lrhs = view(kHeight, kWidth, VK_IMAGE_USAGE_SAMPLED_BIT);
  std::vector<raymeld_image> hrls;
  for (uint32_t i = 0; i < fusion.info().layer_count; ++i)
    hrls.push_back(view(2 * kHeight, 2 * kWidth, VK_IMAGE_USAGE_SAMPLED_BIT));
  const FrameImage buffer(*device_, Shape{2 * kHeight, 2 * kWidth, 3});
  const raymeld_image fused =
      has_images() ? view(2 * kHeight, 2 * kWidth, VK_IMAGE_USAGE_STORAGE_BIT) : image_at(buffer);
  raymeld_frame frame;
  frame.lrhs = &lrhs;
  frame.hrls = hrls.data();
  frame.fused = &fused;
  for (int i = 0; i < 2; ++i) fusion.submit(frame);
  fusion.take_status();
}

TEST_P(EveryWay, OutOfMemoryIsAnError) {
  interposed().fault = {"vkAllocateMemory", 1, VK_ERROR_OUT_OF_DEVICE_MEMORY, true};
  EXPECT_FAILURE(RAYMELD_ERROR_OUT_OF_MEMORY, make(fusion_desc(subject_)), "allocating");
  interposed().fault = {};
  fuse_on_host(fusion_desc(subject_));
}

INSTANTIATE_TEST_SUITE_P(Features, EveryWay,
                         testing::Values(Features{.name = "All"},
                                         Features{.name = "No16BitStorage", .storage_16bit = false},
                                         Features{.name = "NoAddresses", .addresses = false},
                                         Features{.name = "NoMatrices", .matrices = false},
                                         Features{.name = "NoHalfDots", .half_dots = false},
                                         Features{.name = "NoImageWrites", .image_writes = false},
                                         Features{.name = "NoFloatControls", .float_controls = false},
                                         Features{.name = "NoTimelines", .timelines = false},
                                         Features{.name = "NoExternalMemory", .external_memory = false}),
                         [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace raymeld::test
