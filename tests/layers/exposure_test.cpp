// Tests that the device computes the host's exposure from a recorded frame's LRHS, but for rounding.
#include "fusion/exposure.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "api_subject.h"
#include "caller_image.h"
#include "error_of.h"
#include "fusion/fuser.h"

namespace raymeld::test {
namespace {

using reference::Planes;
using reference::Precision;

constexpr float kKey = 0.2f;

double difference(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += std::abs(double(a[i]) - double(b[i]));
  return sum;
}

Planes times(Planes image, double factor) {
  for (double& value : image.data) value = float(value * factor);
  return image;
}

// Holds a frame in the caller's buffers.
struct Frame {
  Planes lrhs_planes;
  FrameImage lrhs, hrls, fused;

  Frame(const Device& device, const Subject& subject, const Planes& lrhs_of)
      : lrhs_planes(lrhs_of),
        lrhs(device, lrhs_of),
        hrls(device, subject.hrls),
        fused(device, Shape{uint32_t(subject.hrls.h), uint32_t(subject.hrls.w), 3}) {}

  std::vector<float> output() const { return floats(fused.read()); }
};

class ExposureTest : public testing::Test {
 protected:
  void use(const Subject& subject, float key = kKey) {
    write_model(file_, subject.architecture, subject.weights, {{"exposure_key", std::to_string(key)}});
  }

  void submit(Commands& pool, VkCommandBuffer commands) {
    pool.end(commands);
    auto info = vk_struct<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
    info.commandBufferCount = 1;
    info.pCommandBuffers = &commands;
    check(device_->vk().QueueSubmit(device_->queue(), 1, &info, VK_NULL_HANDLE), "submitting");
  }
  void wait() { check(device_->vk().DeviceWaitIdle(device_->handle()), "waiting"); }

  // Records and submits a frame with a Fuser and returns the exposure that was used.
  Exposure run(Fuser& fuser, const Frame& frame, float exposure) {
    const uint32_t set = fuser.next_frame();
    Commands pool(*device_);
    const VkCommandBuffer commands = pool.begin("frame");
    fuser.record(commands, frame.lrhs.view(), frame.hrls.view(), frame.fused.view(), exposure);
    submit(pool, commands);
    wait();
    return fuser.program().exposure(set);
  }

  static raymeld_frame frame_of(const std::array<raymeld_image, 3>& images, float exposure = 0) {
    raymeld_frame frame;
    frame.lrhs = &images[0];
    frame.hrls = &images[1];
    frame.fused = &images[2];
    frame.exposure = exposure;
    return frame;
  }

  // Records and submits a frame with the library and returns the fused image.
  std::vector<float> run(Fusion& fusion, const Frame& frame, float exposure = 0, TileSize size = {0, 0}) {
    const std::array images{image_at(frame.lrhs), image_at(frame.hrls), image_at(frame.fused)};
    raymeld_frame asked = frame_of(images, exposure);
    asked.height = size.height;
    asked.width = size.width;
    Commands pool(*device_);
    const VkCommandBuffer commands = pool.begin("frame");
    fusion.record(commands, asked);
    submit(pool, commands);
    wait();
    return frame.output();
  }

  TemporaryDirectory folder_;
  std::string file_ = (folder_ / "model.safetensors").string();
  CallerDevice caller_;
  std::unique_ptr<Device> device_ = Device::wrap(caller_.external());
  Subject subject_ = make_subject(small_architecture(2), 6, 9, 1);
};

// Returns images of four brightnesses, one of special values, and images of one value: black, negative, tiny
// or not finite.
std::vector<Planes> lrhs_images() {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  std::vector<Planes> images;
  for (const double brightness : {1.0, 1e-6, 3e3, 1e30}) {
    Planes image = reference::random_planes(3, 6, 9, reference::Fill::kUniform, images.size());
    for (double& value : image.data) value = float(std::abs(value) * brightness);
    images.push_back(image);
  }
  images.push_back(reference::random_planes(3, 6, 9, reference::Fill::kSpecials, 9));
  for (const float flat : {0.0f, -1.0f, kInfinity, -kInfinity, std::nanf(""), 0x1p-100f}) {
    images.emplace_back(3, 6, 9);
    std::ranges::fill(images.back().data, flat);
  }
  return images;
}

TEST_F(ExposureTest, IsThatOfTheHostButForRoundings) {
  use(subject_);
  const Model model(file_);
  struct Case {
    Precision precision;
    bool addressed;
  };
  const Case cases[] = {
      {.precision = Precision::kFp32, .addressed = false},
      {.precision = Precision::kFp32, .addressed = true},
      {.precision = Precision::kFp16, .addressed = false},
      {.precision = Precision::kFp16, .addressed = true},
  };
  for (const auto& [precision, addressed] : cases) {
    if (addressed && !device_->info().buffer_device_address) continue;
    Fuser fuser(
        *device_, model, 6, 9,
        {.storage = storage_of(precision), .kernels = {.addressed = addressed}, .compute_exposure = true},
        folder_.path());
    for (const Planes& lrhs : lrhs_images()) {
      SCOPED_TRACE(fmt::format("{}{}, first pixel {}", name_of(precision), addressed ? ", by address" : "",
                               lrhs.data[0]));
      const Frame frame(*device_, subject_, lrhs);
      const Exposure found = run(fuser, frame, 0);
      const float host = exposure_of(floats(lrhs).data(), 6 * 9, model.architecture().exposure_key);
      const reference::Bounded expected = reference::exposure(lrhs, model.architecture().exposure_key);
      EXPECT_NEAR(expected.value.data[0], host, 2e-7 * host);
      EXPECT_NEAR(found.factor, host, expected.bound.data[0] + 2e-7 * host);
      EXPECT_NEAR(found.inverse, 1 / host, expected.bound.data[1] + 2e-7 / host);
      EXPECT_LT(expected.bound.data[0], 1e-5 * host);
      // The frame is multiplied and divided by this exposure, which is the same each time.
      const std::vector<float> computed = frame.output();
      EXPECT_EQ(run(fuser, frame, 0).factor, found.factor);
      EXPECT_TRUE(same_bits(frame.output(), computed));
      EXPECT_EQ(run(fuser, frame, found.factor).factor, found.factor);
      const std::vector<float> given = frame.output();
      for (size_t i = 0; i < given.size(); ++i) EXPECT_NEAR(computed[i], given[i], 1e-6 * given[i]);
    }
  }
}

TEST_F(ExposureTest, EachRecordingInFlightHasItsOwn) {
  use(subject_);
  const Model model(file_);
  Fuser fuser(*device_, model, 6, 9, {.compute_exposure = true}, folder_.path());
  for (const float given : {0.0f, 2.0f, 0.0f}) {  // each round uses the same slots
    std::vector<Frame> frames;
    Commands pool(*device_);
    for (uint32_t i = 0; i < kFramesInFlight; ++i) {
      frames.emplace_back(*device_, subject_, times(subject_.lrhs, std::pow(10, i)));
      const VkCommandBuffer commands = pool.begin("frame");
      caller_.take_calls();
      fuser.record(commands, frames[i].lrhs.view(), frames[i].hrls.view(), frames[i].fused.view(), given);
      EXPECT_TRUE(caller_.take_calls().empty());
      submit(pool, commands);
    }
    wait();
    for (uint32_t i = 0; i < kFramesInFlight; ++i) {
      const double expected =
          given != 0 ? given : reference::exposure(frames[i].lrhs_planes, kKey).value.data[0];
      EXPECT_NEAR(fuser.program().exposure(i).factor, expected, 1e-5 * expected);
    }
  }
}

// An exposure of 0 means the description's in each call, or else the one that suits the model.
TEST_F(ExposureTest, ZeroIsTheDescriptionsElseTheModels) {
  use(subject_);
  const Context context(context_desc(caller_.external()));
  const SharedModel model(file_);
  const Frame frame(*device_, subject_, subject_.lrhs);
  const std::vector<float> lrhs = floats(subject_.lrhs);
  raymeld_fusion_desc desc = fusion_desc(subject_);
  Fusion of_model(context, model, desc);
  const std::vector<float> fused = fuse(of_model, subject_).values, computed = run(of_model, frame),
                           plain = run(of_model, frame, 1);
  const double effect = difference(plain, fused);
  EXPECT_GT(effect, 0);
  EXPECT_LT(difference(computed, fused), 1e-3 * effect);
  EXPECT_TRUE(same_bits(run(of_model, frame, of_model.exposure(lrhs.data())), fused));

  desc.exposure = 3;
  Fusion described(context, model, desc);
  EXPECT_TRUE(same_bits(run(described, frame), fuse(described, subject_).values));
  EXPECT_TRUE(same_bits(run(described, frame, 1), plain));

  use(subject_, 0);
  const SharedModel without(file_);
  Fusion as_it_is(context, without, fusion_desc(subject_));
  EXPECT_TRUE(same_bits(run(as_it_is, frame), plain));
  EXPECT_EQ(as_it_is.exposure(lrhs.data()), 1);
}

// A tile needs the exposure of the whole frame, which the recording of a tile cannot compute.
TEST_F(ExposureTest, IsToBeGivenForTiles) {
  const Subject large = make_subject(subject_.architecture, 40, 48, 2);
  use(large);
  const Context context(context_desc(caller_.external()));
  const SharedModel model(file_);
  raymeld_fusion_desc desc = fusion_desc(large);
  desc.max_memory_bytes = Fusion(context, model, desc).info().memory_bytes / 2;
  Fusion fusion(context, model, desc);
  const auto [height, width] = std::pair(fusion.info().tile_height, fusion.info().tile_width);
  ASSERT_LT(height * width, 40u * 48u);
  const Subject tile = make_subject(subject_.architecture, int(height), int(width), 3);
  const Frame frame(*device_, tile, tile.lrhs);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, frame), "tiles", "exposure");
  const std::vector<float> whole = floats(large.lrhs);
  EXPECT_EQ(run(fusion, frame, fusion.exposure(whole.data())).size(), size_t{3} * 4 * height * width);
}

TEST_F(ExposureTest, OfFramesOfOtherSizes) {
  use(subject_);
  const Context context(context_desc(caller_.external()));
  const SharedModel model(file_);
  raymeld_fusion_desc desc;
  desc.height = 22;
  desc.width = 30;
  Fusion fusion(context, model, desc);
  for (const TileSize size : {TileSize{22, 30}, TileSize{9, 13}, TileSize{1, 1}, TileSize{22, 8}}) {
    fusion.prepare_size(size.height, size.width);
    const Subject subject =
        make_subject(subject_.architecture, int(size.height), int(size.width), size.width);
    const Frame frame(*device_, subject, subject.lrhs);
    Fusion same(context, model, fusion_desc(subject));
    const float exposure = same.exposure(floats(subject.lrhs).data());
    const std::vector<float> given = run(fusion, frame, exposure, size);
    const double effect = difference(run(fusion, frame, 1, size), given);
    EXPECT_GT(effect, 0);
    EXPECT_LT(difference(run(fusion, frame, 0, size), given), 1e-3 * effect);
  }
}

TEST_F(ExposureTest, OfImagesOfVulkan) {
  if (!device_->info().image_writes) GTEST_SKIP() << "the device writes no images of any format";
  use(subject_);
  const Context context(context_desc(caller_.external()));
  const SharedModel model(file_);
  raymeld_fusion_desc desc = fusion_desc(subject_);
  desc.input_images = VK_TRUE;
  Fusion fusion(context, model, desc);
  // Each image holds three planes. LRHS is halved, which its view doubles, and its first texel is at (2, 1).
  std::vector<std::unique_ptr<CallerImage>> images;
  const auto image_of_planes = [&](const Planes& planes, int first, double scale, uint32_t x, uint32_t y) {
    const uint32_t width = uint32_t(planes.w) + x, height = uint32_t(planes.h) + y;
    std::vector<float> texels(size_t{4} * width * height, 1e4f);
    for (int row = 0; row < planes.h; ++row)
      for (int column = 0; column < planes.w; ++column)
        for (int c = 0; c < 3; ++c)
          texels[4 * ((size_t(row) + y) * width + size_t(column) + x) + size_t(c)] =
              float(planes.at(first + c, row, column) / scale);
    const auto bytes = std::as_bytes(std::span(texels));
    images.push_back(std::make_unique<CallerImage>(*device_, VK_FORMAT_R32G32B32A32_SFLOAT, width, height,
                                                   VK_IMAGE_USAGE_SAMPLED_BIT));
    images.back()->write({bytes.begin(), bytes.end()}, VK_IMAGE_LAYOUT_GENERAL);
    raymeld_image view;
    view.view = images.back()->view();
    view.x = x;
    view.y = y;
    view.value_scale = float(scale);
    return view;
  };
  const raymeld_image lrhs = image_of_planes(subject_.lrhs, 0, 2, 2, 1);
  std::vector<raymeld_image> hrls;
  for (const int first : {0, 3, 6}) hrls.push_back(image_of_planes(subject_.hrls, first, 1, 0, 0));
  const FrameImage fused(*device_, Shape{12, 18, 3});
  const raymeld_image output = image_at(fused);
  const auto run_with = [&](float exposure) {
    raymeld_frame frame;
    frame.lrhs = &lrhs;
    frame.hrls = hrls.data();
    frame.fused = &output;
    frame.exposure = exposure;
    fusion.submit(frame);
    fusion.take_status();
    return floats(fused.read());
  };
  const std::vector<float> given = run_with(fusion.exposure(floats(subject_.lrhs).data()));
  const double effect = difference(run_with(1), given);
  EXPECT_GT(effect, 0);
  EXPECT_LT(difference(run_with(0), given), 1e-3 * effect);
}

}  // namespace
}  // namespace raymeld::test
