// Tests frames of the library that are joined with the ones before them.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "api_subject.h"
#include "caller_image.h"
#include "golden.h"

namespace raymeld::test {
namespace {

using reference::Planes;

constexpr uint32_t kHeight = 9, kWidth = 14, kScale = 2;

// Holds a frame of noise with motion.
struct Frame {
  Planes lrhs, hrls, motion;

  // Returns the frame with depths from 1 to 2, some of which are unlike those of other frames.
  Frame with_depth(uint64_t seed) const {
    Frame result = *this;
    const Planes depth = noise(1, uint32_t(hrls.h), uint32_t(hrls.w), seed + 200);
    for (int i = 0; i < 2; ++i)
      for (const double value : depth.data) result.motion.data.push_back(1 + value);
    result.motion.c = 4;
    return result;
  }

  explicit Frame(uint64_t seed, uint32_t height = kHeight, uint32_t width = kWidth)
      : lrhs(noise(3, height, width, seed)),
        hrls(noise(9, kScale * height, kScale * width, seed + 100)),
        motion(2, int(kScale * height), int(kScale * width)) {
    for (size_t i = 0; i < motion.data.size(); ++i) motion.data[i] = double(i % 5) / 4 - 0.5;
  }

  static Planes noise(int channels, uint32_t height, uint32_t width, uint64_t seed) {
    Planes image = random_planes(channels, int(height), int(width), Fill::kUniform, seed);
    for (double& value : image.data) value = 0.5 + 0.4 * value;
    return reference::round_to(image, reference::Precision::kFp32);
  }
};

class TemporalTest : public testing::Test {
 protected:
  TemporalTest() { set_cache_home(folder_ / "cache"); }

  static raymeld_fusion_desc desc() {
    raymeld_fusion_desc desc;
    desc.height = kHeight;
    desc.width = kWidth;
    desc.precision = RAYMELD_PRECISION_FP32;
    desc.lrhs_sampling = RAYMELD_SAMPLING_CENTERED;
    desc.compute_variance = VK_TRUE;
    desc.exposure = 0.5f;
    desc.temporal = VK_TRUE;
    return desc;
  }

  static std::vector<float> fuse(Fusion& fusion, const Frame& frame) {
    std::vector<float> fused(size_t{3} * size_t(frame.hrls.h) * size_t(frame.hrls.w));
    fusion.fuse_next(floats(frame.lrhs).data(), floats(frame.hrls).data(), floats(frame.motion).data(),
                     fused.data());
    return fused;
  }

  // Returns what raymeld_fuse_next() makes of frames of a sequence.
  std::vector<std::vector<float>> expected(const std::vector<Frame>& frames,
                                           raymeld_fusion_desc of = desc()) const {
    of.height = uint32_t(frames[0].lrhs.h);
    of.width = uint32_t(frames[0].lrhs.w);
    Fusion fusion(context_, model_, of);
    std::vector<std::vector<float>> all;
    for (const Frame& frame : frames) all.push_back(fuse(fusion, frame));
    return all;
  }

  // Holds a frame's images in buffers.
  struct Buffers {
    FrameImage lrhs, hrls, motion, fused;
    std::array<raymeld_image, 4> images;
    raymeld_frame frame;

    Buffers(const Device& device, const Frame& of)
        : lrhs(device, of.lrhs),
          hrls(device, of.hrls),
          motion(device, of.motion, conform::frame_layouts()[3]),
          fused(device, Shape{uint32_t(of.hrls.h), uint32_t(of.hrls.w), 3}),
          images{image_at(lrhs), image_at(hrls), image_at(motion), image_at(fused)} {
      frame.lrhs = &images[0];
      frame.hrls = &images[1];
      frame.motion = &images[2];
      frame.fused = &images[3];
      frame.height = uint32_t(of.lrhs.h);
      frame.width = uint32_t(of.lrhs.w);
    }
  };

  std::vector<std::unique_ptr<Buffers>> submit(Fusion& fusion, const std::vector<Frame>& frames) const {
    std::vector<std::unique_ptr<Buffers>> all;
    for (const Frame& frame : frames) {
      all.push_back(std::make_unique<Buffers>(*device_, frame));
      fusion.submit(all.back()->frame);
    }
    fusion.take_status();  // waits for them
    return all;
  }

  TemporaryDirectory folder_;
  CallerDevice caller_;
  std::unique_ptr<Device> device_ = Device::wrap(caller_.external());
  Context context_{context_desc(caller_.external())};
  SharedModel model_{golden_model_path("pyramid-x2").string()};
};

const std::vector<Frame>& frames() {
  static const std::vector<Frame> all{Frame(1), Frame(2), Frame(3), Frame(4), Frame(5)};
  return all;
}

TEST_F(TemporalTest, SubmittedFramesHaveTheSameBits) {
  const auto alone = expected(frames());
  EXPECT_FALSE(same_bits(alone[1], expected({frames()[1]})[0])) << "the frame before must matter";
  Fusion fusion(context_, model_, desc());
  const auto submitted = submit(fusion, frames());
  for (size_t i = 0; i < alone.size(); ++i) {
    EXPECT_TRUE(same_bits(floats(submitted[i]->fused.read()), alone[i])) << "frame " << i;
    EXPECT_EQ(submitted[i]->fused.touched_outside(), 0u);
  }
  // A call on the host goes on with the last one of these frames.
  std::vector<Frame> more = frames();
  more.emplace_back(6);
  EXPECT_TRUE(same_bits(fuse(fusion, more.back()), expected(more).back()));
}

TEST_F(TemporalTest, HistoryMayLieInTheCallersMemory) {
  const auto alone = expected(frames());
  raymeld_fusion_desc of = desc();
  const raymeld_memory_needs needs = memory_needs(context_, model_, of);
  Fusion own(context_, model_, of);
  fuse(own, frames()[0]);
  const VkDeviceSize offset = 3 * needs.alignment_bytes, end = offset + needs.history_size_bytes;
  const CallerMemory memory(caller_, end + 4096, needs.memory_type_bits, needs.device_address);
  if (memory.is_null()) GTEST_SKIP() << "a history may not lie in memory that the host sees";
  of.history_memory = memory.handle();
  of.history_memory_offset_bytes = offset;
  of.history_memory_size_bytes = needs.history_size_bytes;
  {
    Fusion fusion(context_, model_, of);
    for (size_t i = 0; i < alone.size(); ++i) EXPECT_TRUE(same_bits(fuse(fusion, frames()[i]), alone[i]));
    const uint64_t kept = 2 * (own.info().history_bytes - 100);  // a saved one begins with a few words
    EXPECT_GE(needs.history_size_bytes, kept);
    EXPECT_LE(fusion.info().memory_bytes + kept, own.info().memory_bytes);
    EXPECT_TRUE(memory.is_untouched(0, offset));
    for (const VkDeviceSize half : {offset, offset + needs.history_size_bytes / 2})
      EXPECT_FALSE(memory.is_untouched(half, half + needs.history_size_bytes / 2));
    EXPECT_TRUE(memory.is_untouched(end, end + 4096));
  }
  of.history_memory_size_bytes -= 1;
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(context_, model_, of), "caller's memory", "expected");
  of.temporal = VK_FALSE;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Fusion(context_, model_, of), "history_memory", "temporal");
}

TEST_F(TemporalTest, RecordingAllocatesNothing) {
  Fusion fusion(context_, model_, desc());
  const Buffers first(*device_, frames()[0]), second(*device_, frames()[1]);
  Commands pool(*device_);
  const VkCommandBuffer commands = pool.begin("frames");
  caller_.take_calls();
  fusion.record(commands, first.frame);
  fusion.record(commands, second.frame);
  EXPECT_FALSE(caller_.take_calls().contains("vkAllocateMemory"));
  pool.end(commands);
  device_->submit_and_wait(commands);
}

TEST_F(TemporalTest, AResetBetweenFramesBeginsAnew) {
  Fusion fusion(context_, model_, desc());
  const std::vector<Frame> first{frames()[0], frames()[1]}, second{frames()[2], frames()[3]};
  submit(fusion, first);
  fusion.reset_history();
  const auto after = submit(fusion, second);
  const auto alone = expected(second);
  for (size_t i = 0; i < second.size(); ++i)
    EXPECT_TRUE(same_bits(floats(after[i]->fused.read()), alone[i])) << "frame " << i;
}

TEST_F(TemporalTest, ASavedHistoryGoesOnInAnotherFusion) {
  const auto alone = expected(frames());
  Fusion first(context_, model_, desc());
  const std::vector<std::byte> empty = first.save_history();
  submit(first, {frames()[0], frames()[1]});
  const std::vector<std::byte> saved = first.save_history();
  EXPECT_EQ(saved.size(), first.info().history_bytes);
  Fusion second(context_, model_, desc());
  second.load_history(saved);
  EXPECT_TRUE(same_bits(fuse(second, frames()[2]), alone[2]));
  second.load_history(saved);
  const auto submitted = submit(second, {frames()[2], frames()[3]});
  EXPECT_TRUE(same_bits(floats(submitted[1]->fused.read()), alone[3]));
  second.load_history(empty);
  EXPECT_TRUE(same_bits(fuse(second, frames()[0]), alone[0]));
  first.reset_history();
  EXPECT_EQ(first.save_history(), empty);

  // A smaller frame leaves less.
  const std::vector<Frame> small{Frame(7, 6, 10), Frame(8, 6, 10)};
  for (Fusion* fusion : {&first, &second}) fusion->prepare_size(6, 10);
  submit(first, {small[0]});
  second.load_history(first.save_history());
  EXPECT_TRUE(same_bits(floats(submit(second, {small[1]})[0]->fused.read()), expected(small)[1]));
  second.load_history(empty);

  std::vector<std::byte> other = saved;
  other[0] = std::byte{'x'};
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, second.load_history(other), "no saved history");
  for (size_t i = 8; i < 32; ++i) {  // the numbers in front, and the first layer's name
    other = saved;
    other[i] ^= std::byte{0x40};
    EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, second.load_history(other), "a history to load");
  }
  other = saved;
  other.pop_back();
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, second.load_history(other), "bytes, expected");
  raymeld_fusion_desc of = desc();
  std::swap(of.height, of.width);
  Fusion turned(context_, model_, of);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, turned.load_history(saved), "14 x 9", "9 x 14");
  of.temporal = VK_FALSE;
  Fusion alone_only(context_, model_, of);
  EXPECT_EQ(alone_only.info().history_bytes, 0u);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, alone_only.save_history(), "not temporal");
  // What failed left the history as it was.
  EXPECT_EQ(second.save_history(), empty);
}

TEST_F(TemporalTest, AFrameOfAnotherSizeIsTheFirstOfItsSize) {
  const std::vector<Frame> small{Frame(7, 6, 10), Frame(8, 6, 10)};
  Fusion fusion(context_, model_, desc());
  fusion.prepare_size(6, 10);
  submit(fusion, {frames()[0]});
  const auto resized = submit(fusion, small);
  const auto alone = expected(small);
  for (size_t i = 0; i < small.size(); ++i)
    EXPECT_TRUE(same_bits(floats(resized[i]->fused.read()), alone[i])) << "frame " << i;
}

// Returns planes [first, first + 4) as texels of four floats; planes that are not there are 0.
std::vector<std::byte> texels_of(const Planes& image, int first) {
  std::vector<std::byte> bytes;
  for (int y = 0; y < image.h; ++y) {
    for (int x = 0; x < image.w; ++x) {
      for (int c = first; c < first + 4; ++c) {
        const float value =
            c < (image.c == 4 ? 4 : std::min(image.c, first + 3)) ? float(image.at(c, y, x)) : 0;
        const auto* begin = reinterpret_cast<const std::byte*>(&value);
        bytes.insert(bytes.end(), begin, begin + sizeof(value));
      }
    }
  }
  return bytes;
}

std::vector<Frame> deep_frames() {
  std::vector<Frame> all;
  for (const Frame& frame : frames()) all.push_back(frame.with_depth(all.size()));
  return all;
}

TEST_F(TemporalTest, DepthTellsSurfacesApart) {
  raymeld_fusion_desc of = desc();
  of.motion_depth = VK_TRUE;
  const std::vector<Frame> deep = deep_frames();
  const auto alone = expected(deep, of);
  EXPECT_FALSE(same_bits(alone[1], expected(frames())[1])) << "depth must matter";
  Fusion fusion(context_, model_, of);
  const auto submitted = submit(fusion, deep);
  for (size_t i = 0; i < alone.size(); ++i)
    EXPECT_TRUE(same_bits(floats(submitted[i]->fused.read()), alone[i])) << "frame " << i;

  // Depths that are none say nothing.
  std::vector<Frame> flat = deep;
  for (Frame& frame : flat) {
    const size_t pixels = frame.motion.data.size() / 4;
    std::fill_n(frame.motion.data.begin() + std::ptrdiff_t(2 * pixels), pixels, -1);
  }
  EXPECT_TRUE(same_bits(expected(flat, of)[1], expected(frames())[1]));
  of.temporal = VK_FALSE;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Fusion(context_, model_, of), "motion_depth", "temporal");
}

TEST_F(TemporalTest, FramesOfVulkanImagesHaveTheSameBits) {
  for (const bool depth : {false, true}) {
    SCOPED_TRACE(depth);
    raymeld_fusion_desc of = desc();
    of.motion_depth = depth;
    const std::vector<Frame> made = depth ? deep_frames() : frames();
    const auto alone = expected(made, of);
    of.input_images = VK_TRUE;
    Fusion fusion(context_, model_, of);
    for (size_t i = 0; i < made.size(); ++i) {
      const Frame& frame = made[i];
      std::vector<std::unique_ptr<CallerImage>> of_frame;
      const auto image = [&](const Planes& planes, int first) {
        of_frame.push_back(std::make_unique<CallerImage>(*device_, VK_FORMAT_R32G32B32A32_SFLOAT,
                                                         uint32_t(planes.w), uint32_t(planes.h),
                                                         VK_IMAGE_USAGE_SAMPLED_BIT));
        of_frame.back()->write(texels_of(planes, first), VK_IMAGE_LAYOUT_GENERAL);
        raymeld_image at;
        at.view = of_frame.back()->view();
        return at;
      };
      const raymeld_image lrhs = image(frame.lrhs, 0);
      raymeld_image motion = image(frame.motion, 0);
      const std::array<raymeld_image, 3> hrls{image(frame.hrls, 0), image(frame.hrls, 3),
                                              image(frame.hrls, 6)};
      const FrameImage fused(*device_, Shape{uint32_t(frame.hrls.h), uint32_t(frame.hrls.w), 3});
      const raymeld_image out = image_at(fused);
      raymeld_frame asked;
      asked.lrhs = &lrhs;
      asked.hrls = hrls.data();
      asked.motion = &motion;
      asked.fused = &out;
      motion.value_bias = 0.5f;
      if (depth) EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.submit(asked), "motion", "value_bias");
      motion.value_bias = 0;
      fusion.submit(asked);
      fusion.take_status();
      EXPECT_TRUE(same_bits(floats(fused.read()), alone[i])) << "frame " << i;
    }
  }
}

TEST_F(TemporalTest, WrongUseSaysWhatWasExpected) {
  Fusion fusion(context_, model_, desc());
  std::vector<float> fused(size_t{3} * kScale * kScale * kHeight * kWidth);
  const std::vector<float> lrhs = floats(frames()[0].lrhs), hrls = floats(frames()[0].hrls);
  const std::vector<float> motion = floats(frames()[0].motion);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.fuse(lrhs.data(), hrls.data(), fused.data()),
                 "motion is NULL");
  Buffers buffers(*device_, frames()[0]);
  buffers.frame.motion = nullptr;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.submit(buffers.frame), "motion is NULL");

  raymeld_fusion_desc of = desc();
  of.temporal = VK_FALSE;
  Fusion alone(context_, model_, of);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT,
                 alone.fuse_next(lrhs.data(), hrls.data(), motion.data(), fused.data()), "not temporal");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, alone.reset_history(), "not temporal");

  of = desc();
  of.compute_variance = VK_FALSE;
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(context_, model_, of), "variance");
  of = desc();
  of.skip_unchanged = VK_TRUE;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, Fusion(context_, model_, of), "skip_unchanged and temporal");
  const SharedModel other(golden_model_path("tiny-x2").string());
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(context_, other, desc()), "keeps no history");
}

}  // namespace
}  // namespace raymeld::test
