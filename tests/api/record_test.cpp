// Tests raymeld inside a program that has its own Vulkan device.
#include <gtest/gtest.h>

#include "api_subject.h"
#include "error_of.h"
#include "fusion/fuser.h"
#include "fusion/tuner.h"
#include "golden.h"

namespace raymeld::test {
namespace {

using reference::Planes;
using reference::Precision;

using Calls = std::map<std::string, int>;

class RecordTest : public testing::Test {
 protected:
  RecordTest() {
    set_cache_home(folder_ / "cache");
    write_model(file_, subject_.architecture, subject_.weights);
  }

  TemporaryDirectory folder_;
  std::string file_ = (folder_ / "model.safetensors").string();
  Subject subject_ = make_subject(small_architecture(2), 6, 9, 1);
};

void end_and_submit(const Device& device, Commands& pool, VkCommandBuffer commands) {
  auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  device.vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT,
                                 0, 1, &barrier, 0, nullptr, 0, nullptr);
  pool.end(commands);
  auto submit = vk_struct<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands;
  check(device.vk().QueueSubmit(device.queue(), 1, &submit, VK_NULL_HANDLE), "submitting");
}

void record(Fusion& fusion, VkCommandBuffer commands, const FrameImage& lrhs, const FrameImage& hrls,
            const FrameImage& fused, float exposure = 0) {
  const raymeld_image images[] = {image_at(lrhs), image_at(hrls), image_at(fused)};
  raymeld_frame frame;
  frame.lrhs = &images[0];
  frame.hrls = &images[1];
  frame.fused = &images[2];
  frame.exposure = exposure;
  fusion.record(commands, frame);
}

TEST_F(RecordTest, ASecondFrameAllocatesNothing) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Model model(file_);
  Fuser fuser(*device, model, 6, 9, {}, folder_.path());
  const Calls setup = caller.take_calls();
  for (const char* name : {"vkAllocateMemory", "vkCreateBuffer", "vkCreateDescriptorPool",
                           "vkAllocateDescriptorSets", "vkCreateComputePipelines", "vkCreateFence"}) {
    EXPECT_TRUE(setup.contains(name)) << name << " is not counted";
  }
  Image first, second;
  fuser.fuse(image_of(subject_.lrhs), image_of(subject_.hrls), first);
  EXPECT_TRUE(caller.take_calls().contains("vkAllocateCommandBuffers"));
  const uint64_t allocated_bytes = fuser.allocated_bytes();
  fuser.fuse(image_of(subject_.lrhs), image_of(subject_.hrls), second);
  EXPECT_EQ(caller.take_calls(), (Calls{{"vkResetFences", 1}, {"vkQueueSubmit", 1}, {"vkWaitForFences", 1}}));
  EXPECT_EQ(fuser.allocated_bytes(), allocated_bytes);
  EXPECT_EQ(first.data, second.data);
}

TEST_F(RecordTest, RecordingCallsNothingThatAllocatesSubmitsOrWaits) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Model model(file_);
  Fuser fuser(*device, model, 6, 9, {}, folder_.path());
  const FrameImage lrhs(*device, subject_.lrhs), hrls(*device, subject_.hrls);
  const FrameImage fused(*device, Shape{12, 18, 3});
  Commands pool(*device);
  for (uint32_t i = 0; i < kFramesInFlight; ++i) {
    const VkCommandBuffer commands = pool.begin("frame");
    caller.take_calls();
    fuser.record(commands, lrhs.view(), hrls.view(), fused.view());
    EXPECT_EQ(caller.take_calls(), Calls{});
    pool.end(commands);
  }
}

TEST_F(RecordTest, AnyLayoutGivesTheBitsOfFuse) {
  for (const Precision precision : kPrecisions) {
    CallerDevice caller;
    const std::unique_ptr<Device> device = Device::wrap(caller.external());
    raymeld_fusion_desc desc = fusion_desc(subject_);
    desc.precision = precision == Precision::kFp16 ? RAYMELD_PRECISION_FP16 : RAYMELD_PRECISION_FP32;
    Fusion fusion(Context(context_desc(caller.external())), SharedModel(file_), desc);
    const raymeld_fusion_info info = fusion.info();
    ASSERT_EQ(info.tile_height, 6u);
    ASSERT_EQ(info.tile_width, 9u);
    EXPECT_EQ(info.scale, 2u);
    EXPECT_EQ(info.frames_in_flight, kFramesInFlight);
    EXPECT_GT(info.memory_bytes, 0u);
    EXPECT_EQ(fusion.layers(), (std::vector<std::string>{"color", "albedo", "normal"}));
    std::vector<float> expected(3 * 12 * 18);
    fusion.fuse(floats(subject_.lrhs).data(), floats(subject_.hrls).data(), expected.data());
    for (const FrameImage::Layout& layout : frame_layouts()) {
      SCOPED_TRACE(fmt::format("{}, offset {}, interleaved {}", name_of(precision), layout.offset_bytes,
                               layout.interleaved));
      const FrameImage lrhs(*device, subject_.lrhs, layout), hrls(*device, subject_.hrls, layout);
      const FrameImage fused(*device, Shape{12, 18, 3}, layout);
      Commands pool(*device);
      const VkCommandBuffer commands = pool.begin("frame");
      record(fusion, commands, lrhs, hrls, fused);
      end_and_submit(*device, pool, commands);
      check(device->vk().DeviceWaitIdle(device->handle()), "waiting");
      EXPECT_TRUE(same_bits(floats(fused.read()), expected));
      EXPECT_EQ(fused.touched_outside(), 0u);
    }
  }
}

TEST_F(RecordTest, EachRecordingHasItsExposure) {
  write_model(file_, subject_.architecture, subject_.weights, {{"exposure_key", "0.2"}});
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Context context(context_desc(caller.external()));
  const SharedModel model(file_);
  Fusion fusion(context, model, fusion_desc(subject_));
  const std::vector<float> lrhs_values = floats(subject_.lrhs), hrls_values = floats(subject_.hrls);
  const float found = fusion.exposure(lrhs_values.data());
  EXPECT_NE(found, 1);
  const FrameImage lrhs(*device, subject_.lrhs), hrls(*device, subject_.hrls);
  std::vector<FrameImage> images;
  Commands pool(*device);
  const std::array exposures{1.0f, found, 3.0f};
  for (const float exposure : exposures) {
    images.emplace_back(*device, Shape{12, 18, 3});
    const VkCommandBuffer commands = pool.begin("frame");
    record(fusion, commands, lrhs, hrls, images.back(), exposure);
    end_and_submit(*device, pool, commands);
  }
  check(device->vk().DeviceWaitIdle(device->handle()), "waiting");
  for (size_t i = 0; i < images.size(); ++i) {
    // An exposure of 0 takes the one that the model asks for, which is `found`.
    raymeld_fusion_desc desc = fusion_desc(subject_);
    desc.exposure = i == 1 ? 0 : exposures[i];
    Fusion same(context, model, desc);
    std::vector<float> expected(3 * 12 * 18);
    same.fuse(lrhs_values.data(), hrls_values.data(), expected.data());
    EXPECT_TRUE(same_bits(floats(images[i].read()), expected)) << exposures[i];
  }
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT,
                 record(fusion, pool.begin("none"), lrhs, hrls, images[0], -1), "exposure");
}

// Records a frame with one render, refuses it with the `other` one too, and returns the image.
std::vector<float> record_alone(const Device& device, Fusion& fusion, const Planes& render,
                                const raymeld_image* raymeld_frame::*own,
                                const raymeld_image* raymeld_frame::*other, const char* refusal) {
  const uint32_t scale = fusion.info().scale;
  const FrameImage input(device, render);
  const FrameImage fused(device, Shape{scale * uint32_t(render.h), scale * uint32_t(render.w), 3});
  const raymeld_image images[] = {image_at(input), image_at(fused)};
  raymeld_frame frame;
  frame.*own = &images[0];
  frame.fused = &images[1];
  Commands pool(device);
  const VkCommandBuffer commands = pool.begin("frame");
  fusion.record(commands, frame);
  frame.*other = &images[0];
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.record(commands, frame), refusal);
  end_and_submit(device, pool, commands);
  check(device.vk().DeviceWaitIdle(device.handle()), "waiting");
  return floats(fused.read());
}

TEST_F(RecordTest, AModelOfScale1TakesNoLrhs) {
  const Subject subject = make_subject(pyramid_architecture(1), 18, 9, 3);
  write_model(file_, subject.architecture, subject.weights, {{"exposure_key", "0.2"}});
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const SharedModel model(file_);
  EXPECT_EQ(model.info().scale, 1u);
  EXPECT_FALSE(model.info().reads_lrhs);
  Fusion fusion(Context(context_desc(caller.external())), model, fusion_desc(subject));
  const std::vector<float> hrls_values = floats(subject.hrls);
  std::vector<float> expected(3 * 18 * 9);
  fusion.fuse(nullptr, hrls_values.data(), expected.data());
  EXPECT_NE(fusion.exposure(hrls_values.data()), 1);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT,
                 fusion.fuse(hrls_values.data(), hrls_values.data(), expected.data()),
                 "lrhs, which must be NULL");

  // The device finds the exposure from the color of HRLS, by sums of 32 bits.
  const std::vector<float> recorded = record_alone(*device, fusion, subject.hrls, &raymeld_frame::hrls,
                                                   &raymeld_frame::lrhs, "lrhs, which must be NULL");
  for (size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(recorded[i], expected[i], 1e-4 * (1 + expected[i]));

  Fusion needs_both(Context(context_desc(caller.external())), SharedModel(golden_model_path(2).string()),
                    fusion_desc(subject_));
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT,
                 needs_both.fuse(nullptr, hrls_values.data(), expected.data()), "lrhs is NULL");
}

TEST_F(RecordTest, AModelThatUpscalesTakesNoHrls) {
  const Subject subject = make_subject(edsr_architecture(2), 6, 9, 3);
  write_model(file_, subject.architecture, subject.weights);
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const SharedModel model(file_);
  EXPECT_TRUE(model.info().reads_lrhs);
  EXPECT_FALSE(model.info().reads_hrls);
  EXPECT_TRUE(model.layers().empty());
  Fusion fusion(Context(context_desc(caller.external())), model, fusion_desc(subject));
  const std::vector<float> lrhs_values = floats(subject.lrhs);
  std::vector<float> expected(3 * 12 * 18);
  fusion.fuse(lrhs_values.data(), nullptr, expected.data());

  EXPECT_TRUE(same_bits(record_alone(*device, fusion, subject.lrhs, &raymeld_frame::lrhs,
                                     &raymeld_frame::hrls, "hrls, which must be NULL"),
                        expected));
}

TEST_F(RecordTest, ThreeRecordingsInFlight) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Model model(file_);
  Fuser fuser(*device, model, 6, 9, {}, folder_.path());
  for (const uint64_t round : {0, 1}) {  // the second reuses the descriptor sets of the first
    std::vector<Subject> subjects;
    std::vector<FrameImage> images;
    Commands pool(*device);
    for (uint64_t i = 0; i < kFramesInFlight; ++i) {
      subjects.push_back(make_subject(subject_.architecture, 6, 9, 10 + 3 * round + i));
      images.emplace_back(*device, subjects.back().lrhs);
      images.emplace_back(*device, subjects.back().hrls);
      images.emplace_back(*device, Shape{12, 18, 3});
      const VkCommandBuffer commands = pool.begin("frame");
      fuser.record(commands, images[3 * i].view(), images[3 * i + 1].view(), images[3 * i + 2].view());
      end_and_submit(*device, pool, commands);
    }
    check(device->vk().DeviceWaitIdle(device->handle()), "waiting");
    for (size_t i = 0; i < subjects.size(); ++i) {
      Image expected;
      fuser.fuse(image_of(subjects[i].lrhs), image_of(subjects[i].hrls), expected);
      EXPECT_TRUE(same_bits(floats(images[3 * i + 2].read()), expected.data)) << round << ", " << i;
    }
  }
}

TEST_F(RecordTest, A16BitDeviceMustBeAsked) {
  CallerDevice caller(false);
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Model model(file_);
  EXPECT_ERROR(Fuser(*device, model, 6, 9, {.storage = Storage::kFloat16}, folder_.path()), "16-bit storage",
               device->info().name);
  Image fused;
  Fuser(*device, model, 6, 9, {}, folder_.path())
      .fuse(image_of(subject_.lrhs), image_of(subject_.hrls), fused);
  EXPECT_EQ(fused.width, 18);
}

TEST_F(RecordTest, AddressesMustBeEnabled) {
  CallerDevice caller(true, false);
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Model model(file_);
  EXPECT_ERROR(Fuser(*device, model, 6, 9, {.kernels = {.addressed = true}}, folder_.path()),
               "buffer addresses", device->info().name);
  std::vector<float> own(3 * 12 * 18), direct(own.size());
  const std::vector<float> lrhs = floats(subject_.lrhs), hrls = floats(subject_.hrls);
  const Context context(context_desc(caller.external()));
  const SharedModel shared(file_);
  raymeld_fusion_desc desc = fusion_desc(subject_);
  Fusion(context, shared, desc).fuse(lrhs.data(), hrls.data(), own.data());
  desc.kernels = RAYMELD_KERNELS_DIRECT;
  Fusion(context, shared, desc).fuse(lrhs.data(), hrls.data(), direct.data());
  EXPECT_TRUE(same_bits(own, direct));
}

TEST_F(RecordTest, CooperativeMatricesMustBeEnabled) {
  const Model model(file_);
  CallerDevice with, without(true, true, false);
  if (!with.external().cooperative_matrix) GTEST_SKIP() << "the device has no cooperative matrices";
  const std::unique_ptr<Device> device = Device::wrap(with.external()),
                                plain = Device::wrap(without.external());
  const CooperativeMatrix matrix = device->info().cooperative_matrix.value();
  const FuserOptions options{
      .storage = Storage::kFloat16,
      .kernels = {.conv2d = [&](const Conv2dShape& shape) { return first_matrix_guess(matrix, shape); }}};
  EXPECT_FALSE(plain->info().cooperative_matrix);
  EXPECT_ERROR(Fuser(*plain, model, 6, 9, options, folder_.path()), "cooperative matrices",
               plain->info().name);
  Image fused;
  Fuser(*device, model, 6, 9, options, folder_.path())
      .fuse(image_of(subject_.lrhs), image_of(subject_.hrls), fused);
  EXPECT_EQ(fused.width, 18);
}

TEST_F(RecordTest, IncompleteHandlesAreRefused) {
  CallerDevice caller;
  ExternalDevice incomplete = caller.external();
  incomplete.queue = VK_NULL_HANDLE;
  EXPECT_ERROR(Device::wrap(incomplete), "null");
  incomplete = caller.external();
  incomplete.get_instance_proc_addr = nullptr;
  EXPECT_ERROR(Device::wrap(incomplete), "get_instance_proc_addr");
}

}  // namespace
}  // namespace raymeld::test
