// Tests frames that raymeld submits itself, among the caller's own submits.
#include <cstdlib>
#include <thread>

#include "api_subject.h"
#include "engine/commands.h"
#include "faults.h"

namespace raymeld::test {
namespace {

template <typename Function>
Function device_function(const Device& device, const char* name) {
  const PFN_vkVoidFunction found = device.vk().GetDeviceProcAddr(device.handle(), name);
  if (!found) throw Error("there is no {}", name);
  return reinterpret_cast<Function>(found);
}

class Semaphore {
 public:
  Semaphore(const Device& device, VkSemaphoreType type) : device_(device) {
    auto kind = vk_struct<VkSemaphoreTypeCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO);
    kind.semaphoreType = type;
    const auto info = vk_struct<VkSemaphoreCreateInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, &kind);
    check(device_function<PFN_vkCreateSemaphore>(device, "vkCreateSemaphore")(device.handle(), &info, nullptr,
                                                                              &semaphore_),
          "creating a semaphore");
  }
  ~Semaphore() {
    device_function<PFN_vkDestroySemaphore>(device_, "vkDestroySemaphore")(device_.handle(), semaphore_,
                                                                           nullptr);
  }
  Semaphore(const Semaphore&) = delete;
  Semaphore& operator=(const Semaphore&) = delete;

  VkSemaphore get() const { return semaphore_; }

  // The host reads, signals and waits for a timeline semaphore.
  uint64_t value() const {
    uint64_t value = 0;
    check(device_function<PFN_vkGetSemaphoreCounterValue>(device_, "vkGetSemaphoreCounterValueKHR")(
              device_.handle(), semaphore_, &value),
          "reading a semaphore");
    return value;
  }
  void signal(uint64_t value) const {
    auto info = vk_struct<VkSemaphoreSignalInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_SIGNAL_INFO);
    info.semaphore = semaphore_;
    info.value = value;
    check(device_function<PFN_vkSignalSemaphore>(device_, "vkSignalSemaphoreKHR")(device_.handle(), &info),
          "signalling a semaphore");
  }
  void wait(uint64_t value) const {
    auto info = vk_struct<VkSemaphoreWaitInfo>(VK_STRUCTURE_TYPE_SEMAPHORE_WAIT_INFO);
    info.semaphoreCount = 1;
    info.pSemaphores = &semaphore_;
    info.pValues = &value;
    check(device_function<PFN_vkWaitSemaphores>(device_, "vkWaitSemaphoresKHR")(device_.handle(), &info,
                                                                                UINT64_MAX),
          "waiting for a semaphore");
  }

 private:
  const Device& device_;
  VkSemaphore semaphore_ = VK_NULL_HANDLE;
};

// Holds a semaphore that is waited for or signalled, and its value, as raymeld_semaphores does.
struct Point {
  VkSemaphore semaphore;
  uint64_t value;
};

raymeld_semaphores semaphores(const std::optional<Point>& wait, const std::optional<Point>& signal) {
  raymeld_semaphores all;
  if (wait) {
    all.wait_count = 1;
    all.wait = &wait->semaphore;
    all.wait_values = &wait->value;
  }
  if (signal) {
    all.signal_count = 1;
    all.signal = &signal->semaphore;
    all.signal_values = &signal->value;
  }
  return all;
}

class SubmitTest : public testing::Test {
 protected:
  SubmitTest() {
    set_cache_home(folder_ / "cache");
    write_model(file_, subject_.architecture, subject_.weights);
    device_ = Device::wrap(caller_.external());
    context_.emplace(context_desc(caller_.external()));
    model_.emplace(file_);
  }

  void SetUp() override {
    if (!caller_.external().timeline_semaphore) GTEST_SKIP() << "the device has no timeline semaphores";
  }

  Fusion make_fusion() const { return Fusion(*context_, *model_, fusion_desc(subject_)); }

  // Holds a frame and its own images.
  struct Frame {
    Subject subject;
    FrameImage lrhs, hrls, fused;
    raymeld_image images[3];
    raymeld_frame frame;

    Frame(const Device& device, const Subject& of)
        : subject(of), lrhs(device, of.lrhs), hrls(device, of.hrls), fused(device, Shape{12, 18, 3}) {
      images[0] = image_at(lrhs);
      images[1] = image_at(hrls);
      images[2] = image_at(fused);
      frame.lrhs = &images[0];
      frame.hrls = &images[1];
      frame.fused = &images[2];
    }
  };
  std::unique_ptr<Frame> make_frame(uint64_t seed) const {
    return std::make_unique<Frame>(*device_, make_subject(subject_.architecture, 6, 9, seed));
  }

  std::vector<float> expected(const Subject& subject) const {
    Fusion own = make_fusion();
    return fuse(own, subject).values;
  }
  void expect_fused(const Frame& frame) const {
    EXPECT_TRUE(same_bits(floats(frame.fused.read()), expected(frame.subject)));
    EXPECT_EQ(frame.fused.touched_outside(), 0u);
  }

  // Submits as the caller does: waits for the value `wait` of a timeline, and signals `signal`.
  void submit(VkCommandBuffer commands, const Semaphore& timeline, uint64_t wait, uint64_t signal) const {
    auto values = vk_struct<VkTimelineSemaphoreSubmitInfo>(VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO);
    values.waitSemaphoreValueCount = values.signalSemaphoreValueCount = 1;
    values.pWaitSemaphoreValues = &wait;
    values.pSignalSemaphoreValues = &signal;
    const VkSemaphore semaphore = timeline.get();
    const VkPipelineStageFlags stage = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT;
    auto info = vk_struct<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO, &values);
    info.waitSemaphoreCount = info.signalSemaphoreCount = info.commandBufferCount = 1;
    info.pWaitSemaphores = info.pSignalSemaphores = &semaphore;
    info.pWaitDstStageMask = &stage;
    info.pCommandBuffers = &commands;
    check(device_->vk().QueueSubmit(device_->queue(), 1, &info, VK_NULL_HANDLE), "submitting");
  }

  TemporaryDirectory folder_;
  std::string file_ = (folder_ / "model.safetensors").string();
  Subject subject_ = make_subject(small_architecture(2), 6, 9, 1);
  CallerDevice caller_;
  std::unique_ptr<Device> device_;
  std::optional<Context> context_;
  std::optional<SharedModel> model_;
};

void copy(const Device& device, VkCommandBuffer commands, VkBuffer from, VkBuffer to, size_t floats) {
  const VkBufferCopy region{0, 0, floats * sizeof(float)};
  device.vk().CmdCopyBuffer(commands, from, to, 1, &region);
}

void barrier(const Device& device, VkCommandBuffer commands, VkPipelineStageFlags from, VkAccessFlags wrote,
             VkPipelineStageFlags to, VkAccessFlags reads) {
  auto memory = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  memory.srcAccessMask = wrote;
  memory.dstAccessMask = reads;
  device.vk().CmdPipelineBarrier(commands, from, to, 0, 1, &memory, 0, nullptr, 0, nullptr);
}

// The host writes the inputs after all submits, each of which waits for the step before it.
TEST_F(SubmitTest, BetweenTheCallersOwnSubmits) {
  Fusion fusion = make_fusion();
  const std::vector<float> lrhs = floats(subject_.lrhs), hrls = floats(subject_.hrls);
  const size_t fused_size = 4 * lrhs.size();
  const Buffer lrhs_host(*device_, lrhs.size() * 4, Memory::kUpload, "lrhs of the host"),
      hrls_host(*device_, hrls.size() * 4, Memory::kUpload, "hrls of the host"),
      fused_host(*device_, fused_size * 4, Memory::kReadback, "fused of the host");
  const auto frame = make_frame(2);  // holds other inputs than those that the host writes
  const Semaphore timeline(*device_, VK_SEMAPHORE_TYPE_TIMELINE);
  Commands pool(*device_);
  const VkCommandBuffer before = pool.begin("before");
  barrier(*device_, before, VK_PIPELINE_STAGE_HOST_BIT, VK_ACCESS_HOST_WRITE_BIT,
          VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_READ_BIT);
  copy(*device_, before, lrhs_host.handle(), frame->images[0].buffer, lrhs.size());
  copy(*device_, before, hrls_host.handle(), frame->images[1].buffer, hrls.size());
  pool.end(before);
  const VkCommandBuffer after = pool.begin("after");
  copy(*device_, after, frame->images[2].buffer, fused_host.handle(), fused_size);
  barrier(*device_, after, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT,
          VK_PIPELINE_STAGE_HOST_BIT, VK_ACCESS_HOST_READ_BIT);
  pool.end(after);

  submit(before, timeline, 1, 2);
  fusion.submit(frame->frame, semaphores(Point{timeline.get(), 2}, Point{timeline.get(), 3}));
  submit(after, timeline, 3, 4);
  EXPECT_EQ(timeline.value(), 0u);
  std::ranges::copy(lrhs, static_cast<float*>(lrhs_host.mapped()));
  std::ranges::copy(hrls, static_cast<float*>(hrls_host.mapped()));
  timeline.signal(1);
  timeline.wait(4);
  fused_host.invalidate();
  const auto* const fused = static_cast<const float*>(fused_host.mapped());
  EXPECT_TRUE(same_bits({fused, fused_size}, expected(subject_)));
}

TEST_F(SubmitTest, MoreFramesThanMayBeInFlight) {
  Fusion fusion = make_fusion();
  const uint32_t in_flight = fusion.info().frames_in_flight;
  const Semaphore timeline(*device_, VK_SEMAPHORE_TYPE_TIMELINE), start(*device_, VK_SEMAPHORE_TYPE_TIMELINE);
  std::vector<std::unique_ptr<Frame>> frames;
  for (uint64_t i = 0; i < 3 * in_flight + 1; ++i) frames.push_back(make_frame(10 + i));
  caller_.take_calls();
  for (uint64_t i = 0; i < frames.size(); ++i) {
    if (i == in_flight) {
      // None of these frames is done, and none was waited for.
      EXPECT_FALSE(caller_.take_calls().contains("vkWaitForFences"));
      EXPECT_EQ(timeline.value(), 0u);
      start.signal(1);
    }
    fusion.submit(frames[i]->frame, semaphores(Point{start.get(), 1}, Point{timeline.get(), i + 1}));
    if (i < in_flight) continue;
    // The submit waits for one of these frames, and makes no objects.
    EXPECT_EQ(caller_.take_calls(), (std::map<std::string, int>{{"vkWaitForFences", 1},
                                                                {"vkResetFences", 1},
                                                                {"vkResetCommandBuffer", 1},
                                                                {"vkBeginCommandBuffer", 1},
                                                                {"vkEndCommandBuffer", 1},
                                                                {"vkQueueSubmit", 1}}));
  }
  timeline.wait(frames.size());
  for (const auto& frame : frames) expect_fused(*frame);
}

TEST_F(SubmitTest, AmongRecordings) {
  Fusion fusion = make_fusion();
  const Semaphore timeline(*device_, VK_SEMAPHORE_TYPE_TIMELINE);
  std::vector<std::unique_ptr<Frame>> frames;
  Commands pool(*device_);
  uint64_t done = 0;
  for (const bool recorded : {true, false, false, false, true, false}) {
    frames.push_back(make_frame(20 + done));
    // The caller waits for the earlier frame whose place this one takes, as it must for a recording.
    if (done >= fusion.info().frames_in_flight) timeline.wait(done + 1 - fusion.info().frames_in_flight);
    if (recorded) {
      const VkCommandBuffer commands = pool.begin("the caller's");
      fusion.record(commands, frames.back()->frame);
      pool.end(commands);
      submit(commands, timeline, done, done + 1);
    } else {
      fusion.submit(frames.back()->frame,
                    semaphores(Point{timeline.get(), done}, Point{timeline.get(), done + 1}));
    }
    ++done;
  }
  timeline.wait(done);
  for (const auto& frame : frames) expect_fused(*frame);
}

TEST_F(SubmitTest, TwoFusionsInTwoThreads) {
  constexpr uint64_t kFrames = 7;
  std::vector<std::unique_ptr<Frame>> frames;
  for (uint64_t i = 0; i < 2 * kFrames; ++i) frames.push_back(make_frame(30 + i));
  const Semaphore first(*device_, VK_SEMAPHORE_TYPE_TIMELINE), second(*device_, VK_SEMAPHORE_TYPE_TIMELINE);
  const auto work = [&](const Semaphore& timeline, size_t begin) {
    Fusion fusion = make_fusion();
    for (uint64_t i = 0; i < kFrames; ++i) {
      // Every frame waits for the one before it.
      fusion.submit(frames[begin + i]->frame,
                    semaphores(i > 0 ? std::optional(Point{timeline.get(), i}) : std::nullopt,
                               Point{timeline.get(), i + 1}));
    }
    timeline.wait(kFrames);
  };
  std::thread other(work, std::cref(second), kFrames);
  work(first, 0);
  other.join();
  for (const auto& frame : frames) expect_fused(*frame);
}

TEST_F(SubmitTest, BinarySemaphores) {
  Fusion fusion = make_fusion();
  const Semaphore binary(*device_, VK_SEMAPHORE_TYPE_BINARY), timeline(*device_, VK_SEMAPHORE_TYPE_TIMELINE);
  const auto first = make_frame(40), second = make_frame(41);
  const VkSemaphore one = binary.get();
  raymeld_semaphores signals;
  signals.signal_count = 1;
  signals.signal = &one;
  fusion.submit(first->frame, signals);
  // The second frame waits for a semaphore of each kind.
  const VkSemaphore waits[] = {one, timeline.get()}, done = timeline.get();
  const uint64_t values[] = {0, 1}, two = 2;
  raymeld_semaphores both;
  both.wait_count = 2;
  both.wait = waits;
  both.wait_values = values;
  both.signal_count = 1;
  both.signal = &done;
  both.signal_values = &two;
  fusion.submit(second->frame, both);
  timeline.signal(1);
  timeline.wait(2);
  expect_fused(*first);
  expect_fused(*second);
}

TEST_F(SubmitTest, WhatAsksForResultsWaits) {
  const auto first = make_frame(50), second = make_frame(51);
  Fusion fusion = make_fusion();
  fusion.submit(first->frame);
  EXPECT_EQ(fusion.take_status().not_finite, 0u);
  expect_fused(*first);
  fusion.submit(second->frame);
  EXPECT_EQ(fuse(fusion, subject_).values, expected(subject_));
  expect_fused(*second);
  fusion.submit(first->frame);
  fusion = make_fusion();  // destroys a fusion that may have a pending frame, which validation watches
}

TEST_F(SubmitTest, WhatIsWrongIsNamed) {
  const auto frame = make_frame(60);
  Fusion fusion = make_fusion();
  const auto refused = [&](const raymeld_frame& what, const raymeld_semaphores& how, const char* text) {
    EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.submit(what, how), text);
  };
  raymeld_semaphores missing;
  missing.wait_count = 1;
  refused(frame->frame, missing, "wait is NULL");
  const VkSemaphore none[] = {VK_NULL_HANDLE};
  missing.wait = none;
  refused(frame->frame, missing, "wait[0] is VK_NULL_HANDLE");
  missing = {};
  missing.signal_count = 1;
  refused(frame->frame, missing, "signal is NULL");
  missing = {};
  missing.struct_size = 1;
  refused(frame->frame, missing, "raymeld_semaphores: struct_size is 1");
  refused({}, {}, "lrhs is NULL");
  EXPECT_EQ(raymeld_submit(nullptr, &frame->frame, nullptr), RAYMELD_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(raymeld_submit(fusion.get(), nullptr, nullptr), RAYMELD_ERROR_INVALID_ARGUMENT);
  interposed().fault = {.function = "vkQueueSubmit", .call = 1, .code = VK_ERROR_OUT_OF_DEVICE_MEMORY};
  EXPECT_FAILURE(RAYMELD_ERROR_OUT_OF_MEMORY, fusion.submit(frame->frame), "submitting");
  interposed().fault = {.function = "vkBeginCommandBuffer", .call = 1, .code = VK_ERROR_OUT_OF_DEVICE_MEMORY};
  EXPECT_FAILURE(RAYMELD_ERROR_OUT_OF_MEMORY, fusion.submit(frame->frame), "recording");
  for (int i = 0; i < 4; ++i) fusion.submit(frame->frame);
  fusion.take_status();
  expect_fused(*frame);

  const Semaphore timeline(*device_, VK_SEMAPHORE_TYPE_TIMELINE);
  raymeld_context_desc without = context_desc(caller_.external());
  without.enabled_features &= ~uint32_t(RAYMELD_FEATURE_TIMELINE_SEMAPHORE);
  Fusion plain(Context(without), *model_, fusion_desc(subject_));
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT,
                 plain.submit(frame->frame, semaphores({}, Point{timeline.get(), 5})),
                 "signal_values[0] is 5", "RAYMELD_FEATURE_TIMELINE_SEMAPHORE");
  plain.submit(frame->frame);
  Fusion own(Context(), *model_, fusion_desc(subject_));
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT,
                 own.submit(frame->frame, semaphores({}, Point{timeline.get(), 5})), "raymeld's own");
}

// A pending frame may still read the data that a recording would write over.
TEST_F(SubmitTest, ARecordingIsRefusedInPlaceOfAPendingFrame) {
  Fusion fusion = make_fusion();
  const Semaphore start(*device_, VK_SEMAPHORE_TYPE_TIMELINE);
  const auto frame = make_frame(80);
  const uint32_t in_flight = fusion.info().frames_in_flight;
  for (uint32_t i = 0; i < in_flight; ++i) fusion.submit(frame->frame, semaphores(Point{start.get(), 1}, {}));
  Commands pool(*device_);
  const VkCommandBuffer commands = pool.begin("the caller's");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.record(commands, frame->frame),
                 std::to_string(in_flight) + " frames are pending");
  start.signal(1);
  fusion.take_status();
  fusion.record(commands, frame->frame);
  pool.end(commands);
}

TEST_F(SubmitTest, ALostDeviceIsTold) {
  const auto frame = make_frame(70);
  Fusion fusion = make_fusion();
  fusion.submit(frame->frame);
  interposed().fault = {.function = "vkQueueSubmit", .call = 1, .code = VK_ERROR_DEVICE_LOST};
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE_LOST, fusion.submit(frame->frame), "VK_ERROR_DEVICE_LOST");
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE_LOST, fusion.take_status(), "VK_ERROR_DEVICE_LOST");
}

}  // namespace
}  // namespace raymeld::test
