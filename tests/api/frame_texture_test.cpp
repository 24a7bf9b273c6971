// Tests that frames of Vulkan images give the same bits as frames of buffers.
#include <Imath/half.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <random>

#include "api_subject.h"
#include "caller_image.h"

namespace raymeld::test {
namespace {

using reference::Planes;

constexpr VkImageLayout kReadOnly = VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL;

// Holds texels as a device does, and the floats (3, h, w) that they stand for.
struct Texels {
  VkFormat format;
  std::vector<std::byte> bytes;
  std::vector<float> values;
};

void append(std::vector<std::byte>& bytes, const auto& value) {
  const auto* begin = reinterpret_cast<const std::byte*>(&value);
  bytes.insert(bytes.end(), begin, begin + sizeof(value));
}

// Decodes an unsigned float of 5 bits of exponent and `mantissa_bits` of mantissa.
float small_float(uint32_t bits, uint32_t mantissa_bits) {
  return Imath::half(Imath::half::FromBits, uint16_t(bits << (10 - mantissa_bits)));
}

// Appends a random texel of a format; `values` gets its first three channels as the host computes them.
void append_texel(VkFormat format, std::mt19937& random, std::vector<std::byte>& bytes,
                  std::array<float, 3>& values) {
  const auto bits = [&](uint32_t count) { return uint32_t(random()) >> (32 - count); };
  switch (format) {
    case VK_FORMAT_R16G16B16A16_SFLOAT:
      for (float& value : values) {
        const Imath::half half(float(bits(12)) / 1024);
        append(bytes, half.bits());
        value = half;
      }
      return append(bytes, uint16_t{0x7e00});  // alpha is NaN, as nothing may read it
    case VK_FORMAT_B10G11R11_UFLOAT_PACK32: {
      const auto small = [&](uint32_t mantissa) { return (bits(3) + 10) << mantissa | bits(mantissa); };
      const std::array<uint32_t, 3> packed{small(6), small(6), small(5)};
      values = {small_float(packed[0], 6), small_float(packed[1], 6), small_float(packed[2], 5)};
      return append(bytes, packed[0] | packed[1] << 11 | packed[2] << 22);
    }
    case VK_FORMAT_R8G8B8A8_UNORM:
      for (float& value : values) {
        const auto byte = uint8_t(bits(8));
        append(bytes, byte);
        value = float(byte) / 255;
      }
      return append(bytes, uint8_t{7});
    case VK_FORMAT_A2B10G10R10_UNORM_PACK32: {
      uint32_t packed = 0;
      for (uint32_t c = 0; c < 3; ++c) {
        const uint32_t channel = bits(10);
        packed |= channel << 10 * c;
        values[c] = 2 * float(channel) / 1023 - 1;
      }
      return append(bytes, packed);
    }
    default:
      FAIL() << "no such format here: " << format;
  }
}

Texels random_texels(VkFormat format, uint32_t width, uint32_t height, uint32_t seed) {
  std::mt19937 random(seed);
  Texels texels{format, {}, std::vector<float>(size_t{3} * width * height)};
  for (size_t i = 0; i < size_t{width} * height; ++i) {
    std::array<float, 3> values{};
    append_texel(format, random, texels.bytes, values);
    for (size_t c = 0; c < 3; ++c) texels.values[c * width * height + i] = values[c];
  }
  return texels;
}

// Returns three of the planes as float texels, with `border` other texels on the left and at the top.
std::vector<std::byte> float_texels(const Planes& image, int first, uint32_t border) {
  const std::vector<float> values = floats(image);
  const auto plane = size_t(image.h) * size_t(image.w);
  std::vector<std::byte> bytes;
  for (int y = -int(border); y < image.h; ++y) {
    for (int x = -int(border); x < image.w; ++x) {
      for (int c = 0; c < 4; ++c) {
        const bool inside = c < 3 && x >= 0 && y >= 0;
        append(bytes, inside ? values[size_t(first + c) * plane + size_t(y) * size_t(image.w) + size_t(x)]
                             : -777.0f);
      }
    }
  }
  return bytes;
}

class FrameTextureTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!caller_.external().image_writes) GTEST_SKIP() << "the device writes no images of any format";
  }

  // Returns the image that is fused from buffers.
  std::vector<float> expected(raymeld_fusion_desc desc, const std::vector<float>& lrhs,
                              const std::vector<float>& hrls) {
    desc.input_images = desc.output_image = VK_FALSE;
    Fusion fusion(context_, *model_, desc);
    std::vector<float> fused(lrhs.size() * fusion.info().scale * fusion.info().scale);
    fusion.fuse(model_->info().reads_lrhs ? lrhs.data() : nullptr, hrls.data(), fused.data());
    return fused;
  }

  void use(const Subject& subject) {
    write_model(file_, subject.architecture, subject.weights);
    model_.emplace(file_);
  }

  CallerImage& input(VkFormat format, uint32_t width, uint32_t height, const std::vector<std::byte>& texels,
                     VkImageLayout layout) {
    auto image = std::make_unique<CallerImage>(*device_, format, width, height, VK_IMAGE_USAGE_SAMPLED_BIT);
    image->write(texels, layout);
    return *inputs_.emplace_back(std::move(image));
  }

  // Returns an output image whose texels are all 0xff.
  std::unique_ptr<CallerImage> output(VkFormat format, uint32_t width, uint32_t height) {
    auto image = std::make_unique<CallerImage>(*device_, format, width, height, VK_IMAGE_USAGE_STORAGE_BIT);
    image->write(std::vector<std::byte>(size_t{16} * width * height, std::byte{0xff}),
                 VK_IMAGE_LAYOUT_GENERAL);
    return image;
  }

  void run(Fusion& fusion, const raymeld_image& lrhs, const std::vector<raymeld_image>& hrls,
           const raymeld_image& fused) {
    raymeld_frame frame;
    if (model_->info().reads_lrhs) frame.lrhs = &lrhs;
    frame.hrls = hrls.data();
    frame.fused = &fused;
    Commands pool(*device_);
    const VkCommandBuffer commands = pool.begin("frame");
    fusion.record(commands, frame);
    pool.end(commands);
    device_->submit_and_wait(commands);
  }

  static raymeld_image view_of(const CallerImage& image, VkImageLayout layout = VK_IMAGE_LAYOUT_GENERAL,
                               uint32_t x = 0, uint32_t y = 0) {
    raymeld_image view;
    view.view = image.view();
    view.layout = layout;
    view.x = x;
    view.y = y;
    return view;
  }

  TemporaryDirectory folder_;
  std::string file_ = (folder_ / "model.safetensors").string();
  CallerDevice caller_;
  std::unique_ptr<Device> device_ = Device::wrap(caller_.external());
  Context context_{context_desc(caller_.external())};
  std::optional<SharedModel> model_;
  std::vector<std::unique_ptr<CallerImage>> inputs_;
};

raymeld_fusion_desc image_desc(const Subject& subject) {
  raymeld_fusion_desc desc = fusion_desc(subject);
  desc.input_images = desc.output_image = VK_TRUE;
  return desc;
}

// Returns the planes of interleaved texels of four floats, without the border, which must be untouched.
std::vector<float> planes_of_texels(const std::vector<std::byte>& bytes, uint32_t width, uint32_t height,
                                    uint32_t border) {
  const auto* floats = reinterpret_cast<const float*>(bytes.data());
  std::vector<float> planes(size_t{3} * width * height);
  for (uint32_t y = 0; y < height + border; ++y) {
    for (uint32_t x = 0; x < width + border; ++x) {
      const float* texel = floats + 4 * (size_t{y} * (width + border) + x);
      if (x < border || y < border) {
        EXPECT_EQ(std::bit_cast<uint32_t>(texel[0]), ~0u) << x << ", " << y;
        continue;
      }
      EXPECT_EQ(texel[3], 1);
      for (uint32_t c = 0; c < 3; ++c)
        planes[(size_t{c} * height + y - border) * width + x - border] = texel[c];
    }
  }
  return planes;
}

TEST_F(FrameTextureTest, FloatsHaveTheBitsOfBuffers) {
  struct Case {
    Subject subject;
    raymeld_precision precision = RAYMELD_PRECISION_FP32;
    raymeld_kernels kernels = RAYMELD_KERNELS_AUTO;
    uint32_t border = 0;
    VkImageLayout layout = VK_IMAGE_LAYOUT_GENERAL;
    bool variance = false;
  };
  reference::Architecture with_variance = small_architecture(2);
  with_variance.hrls_layers.push_back(reference::LayerKind::kVariance);
  const Case cases[] = {
      {.subject = make_subject(small_architecture(2), 6, 9, 1)},
      {.subject = make_subject(pyramid_architecture(2), 6, 9, 7)},
      {.subject = make_subject(pyramid_architecture(1), 17, 9, 8)},
      {.subject = make_subject(small_architecture(2), 10, 9, 2),
       .precision = RAYMELD_PRECISION_FP16,
       .kernels = RAYMELD_KERNELS_DIRECT,
       .border = 3,
       .layout = kReadOnly},
      {.subject = make_subject(small_architecture(2), 20, 30, 4),
       .kernels = RAYMELD_KERNELS_DIRECT,
       .border = 2},
      {.subject = make_subject(with_variance, 6, 9, 5),
       .kernels = RAYMELD_KERNELS_DIRECT,
       .border = 3,
       .layout = kReadOnly,
       .variance = true},
  };
  for (const Case& at : cases) {
    Subject subject = at.subject;
    SCOPED_TRACE(subject.lrhs.h);
    use(subject);
    if (at.variance) subject.hrls = slice(reference::exact(subject.hrls), 0, subject.hrls.c - 3).value;
    raymeld_fusion_desc desc = image_desc(subject);
    desc.precision = at.precision;
    desc.kernels = at.kernels;
    desc.compute_variance = at.variance;
    Fusion fusion(context_, *model_, desc);
    const auto texture = [&](const Planes& image, int first) {
      return view_of(input(VK_FORMAT_R32G32B32A32_SFLOAT, uint32_t(image.w) + at.border,
                           uint32_t(image.h) + at.border, float_texels(image, first, at.border), at.layout),
                     at.layout, at.border, at.border);
    };
    std::vector<raymeld_image> hrls;
    for (int first = 0; first < subject.hrls.c; first += 3) hrls.push_back(texture(subject.hrls, first));
    const auto width = uint32_t(subject.hrls.w), height = uint32_t(subject.hrls.h);
    const auto fused = output(VK_FORMAT_R32G32B32A32_SFLOAT, width + at.border, height + at.border);
    run(fusion, texture(subject.lrhs, 0), hrls,
        view_of(*fused, VK_IMAGE_LAYOUT_GENERAL, at.border, at.border));
    EXPECT_TRUE(same_bits(planes_of_texels(fused->read(), width, height, at.border),
                          expected(desc, floats(subject.lrhs), floats(subject.hrls))));
    EXPECT_EQ(fusion.take_status().not_finite, 0u);
  }
}

TEST_F(FrameTextureTest, FormatsAreWhatTheyStandFor) {
  const Subject subject = make_subject(small_architecture(2), 8, 10, 5);
  use(subject);
  Fusion fusion(context_, *model_, image_desc(subject));
  ASSERT_EQ(fusion.layers(), (std::vector<std::string>{"color", "albedo", "normal"}));
  const Texels low = random_texels(VK_FORMAT_R16G16B16A16_SFLOAT, 10, 8, 1);
  const Texels layers[] = {random_texels(VK_FORMAT_B10G11R11_UFLOAT_PACK32, 20, 16, 2),
                           random_texels(VK_FORMAT_R8G8B8A8_UNORM, 20, 16, 3),
                           random_texels(VK_FORMAT_A2B10G10R10_UNORM_PACK32, 20, 16, 4)};
  std::vector<raymeld_image> hrls;
  std::vector<float> values;
  for (const Texels& layer : layers) {
    hrls.push_back(view_of(input(layer.format, 20, 16, layer.bytes, kReadOnly), kReadOnly));
    values.insert(values.end(), layer.values.begin(), layer.values.end());
  }
  hrls[2].value_scale = 2;
  hrls[2].value_bias = -1;
  const raymeld_image lrhs = view_of(input(low.format, 10, 8, low.bytes, kReadOnly), kReadOnly);
  const std::vector<float> exact = expected(image_desc(subject), low.values, values);

  const auto fused = output(VK_FORMAT_R32G32B32A32_SFLOAT, 20, 16);
  run(fusion, lrhs, hrls, view_of(*fused));
  const std::vector<float> wide = planes_of_texels(fused->read(), 20, 16, 0);
  // A driver may compute k / 255 in another way.
  for (size_t i = 0; i < exact.size(); ++i) EXPECT_NEAR(wide[i], exact[i], 1e-5f * (1 + exact[i])) << i;

  const auto half = output(VK_FORMAT_R16G16B16A16_SFLOAT, 20, 16);
  run(fusion, lrhs, hrls, view_of(*half));
  const std::vector<std::byte> half_texels = half->read();
  const auto* halves = reinterpret_cast<const uint16_t*>(half_texels.data());
  const auto packed = output(VK_FORMAT_B10G11R11_UFLOAT_PACK32, 20, 16);
  run(fusion, lrhs, hrls, view_of(*packed));
  const std::vector<std::byte> packed_texels = packed->read();
  const auto* words = reinterpret_cast<const uint32_t*>(packed_texels.data());
  for (size_t i = 0; i < size_t{20 * 16}; ++i) {
    const std::array<float, 3> small{small_float(words[i] & 0x7ff, 6), small_float(words[i] >> 11 & 0x7ff, 6),
                                     small_float(words[i] >> 22, 5)};
    for (size_t c = 0; c < 3; ++c) {
      const float value = wide[c * 20 * 16 + i];
      EXPECT_NEAR(Imath::half(Imath::half::FromBits, halves[4 * i + c]), value, value / 1024 + 1e-7f) << i;
      EXPECT_NEAR(small[c], value, value / 32 + 1e-5f) << i;
    }
  }
}

TEST_F(FrameTextureTest, OctahedralNormalsAreUnfolded) {
  Subject subject = make_subject(pyramid_architecture(2), 8, 10, 6);
  use(subject);
  const std::vector<std::string> names = SharedModel(file_).layers();
  const auto normal = size_t(std::ranges::find(names, "normal") - names.begin());
  ASSERT_LT(normal, names.size());
  const size_t plane = size_t{16} * 20;
  std::vector<float> values = floats(subject.hrls);
  std::vector<std::byte> folded;
  std::mt19937 random(7);
  std::uniform_real_distribution<float> uniform(-1, 1);
  size_t below = 0;
  for (size_t i = 0; i < plane; ++i) {
    const float x = uniform(random), y = uniform(random), z = uniform(random);
    const float length = std::hypot(x, y, z), sum = std::abs(x) + std::abs(y) + std::abs(z);
    const std::array<float, 3> unit{x / length, y / length, z / length};
    for (size_t c = 0; c < 3; ++c) values[(3 * normal + c) * plane + i] = unit[c];
    std::array<float, 2> fold{x / sum, y / sum};
    if (z < 0) {
      fold = {std::copysign(1 - std::abs(y) / sum, x), std::copysign(1 - std::abs(x) / sum, y)};
      ++below;
    }
    append(folded, fold);
  }
  EXPECT_GT(below, plane / 4);
  Fusion fusion(context_, *model_, image_desc(subject));
  std::vector<raymeld_image> hrls;
  for (size_t layer = 0; layer < names.size(); ++layer) {
    const bool is_normal = layer == normal;
    hrls.push_back(view_of(is_normal ? input(VK_FORMAT_R32G32_SFLOAT, 20, 16, folded, kReadOnly)
                                     : input(VK_FORMAT_R32G32B32A32_SFLOAT, 20, 16,
                                             float_texels(subject.hrls, 3 * int(layer), 0), kReadOnly),
                           kReadOnly));
    if (is_normal) hrls.back().texels = RAYMELD_TEXELS_OCTAHEDRAL;
  }
  const raymeld_image lrhs = view_of(
      input(VK_FORMAT_R32G32B32A32_SFLOAT, 10, 8, float_texels(subject.lrhs, 0, 0), kReadOnly), kReadOnly);
  const auto fused = output(VK_FORMAT_R32G32B32A32_SFLOAT, 20, 16);
  run(fusion, lrhs, hrls, view_of(*fused));
  const std::vector<float> got = planes_of_texels(fused->read(), 20, 16, 0);
  const std::vector<float> exact = expected(image_desc(subject), floats(subject.lrhs), values);
  for (size_t i = 0; i < exact.size(); ++i) EXPECT_NEAR(got[i], exact[i], 1e-4f * (1 + exact[i])) << i;
}

TEST_F(FrameTextureTest, ABufferMayBeOfOneSideOnly) {
  const Subject subject = make_subject(small_architecture(2), 6, 9, 8);
  use(subject);
  const std::vector<float> exact = expected(fusion_desc(subject), floats(subject.lrhs), floats(subject.hrls));
  raymeld_fusion_desc desc = fusion_desc(subject);
  desc.output_image = VK_TRUE;
  Fusion to_image(context_, *model_, desc);
  const FrameImage lrhs(*device_, subject.lrhs), hrls(*device_, subject.hrls);
  const auto buffer_of = [](const FrameImage& image) {
    raymeld_image buffer;
    buffer.buffer = image.view().buffer;
    return buffer;
  };
  const auto fused = output(VK_FORMAT_R32G32B32A32_SFLOAT, 18, 12);
  run(to_image, buffer_of(lrhs), {buffer_of(hrls)}, view_of(*fused));
  EXPECT_TRUE(same_bits(planes_of_texels(fused->read(), 18, 12, 0), exact));

  desc.output_image = VK_FALSE;
  desc.input_images = VK_TRUE;
  Fusion from_images(context_, *model_, desc);
  std::vector<raymeld_image> layers;
  for (int first = 0; first < subject.hrls.c; first += 3) {
    layers.push_back(view_of(input(VK_FORMAT_R32G32B32A32_SFLOAT, 18, 12,
                                   float_texels(subject.hrls, first, 0), VK_IMAGE_LAYOUT_GENERAL)));
  }
  const FrameImage buffer(*device_, Shape{12, 18, 3});
  run(from_images,
      view_of(input(VK_FORMAT_R32G32B32A32_SFLOAT, 9, 6, float_texels(subject.lrhs, 0, 0),
                    VK_IMAGE_LAYOUT_GENERAL)),
      layers, buffer_of(buffer));
  EXPECT_TRUE(same_bits(floats(buffer.read()), exact));
}

TEST_F(FrameTextureTest, WhatAnImageLacksIsSaid) {
  const Subject subject = make_subject(small_architecture(2), 6, 9, 9);
  use(subject);
  Fusion fusion(context_, *model_, image_desc(subject));
  std::vector<float> values(3 * 12 * 18);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, fusion.fuse(values.data(), values.data(), values.data()),
                 "raymeld_record()");
  const auto image = output(VK_FORMAT_R32G32B32A32_SFLOAT, 18, 12);
  const raymeld_image good = view_of(*image);
  raymeld_image bad = good;
  bad.view = VK_NULL_HANDLE;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, bad, {good, good, good}, good), "lrhs: view");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, good, {good, good, bad}, good),
                 "hrls[2], normal: view");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, good, {bad, good, good}, good), "hrls: view");
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, good, {good, good, good}, bad), "fused: view");
  bad = view_of(*image, kReadOnly);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, good, {good, good, good}, bad),
                 "fused: layout is 5", "GENERAL");
  bad = view_of(*image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL);
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, bad, {good, good, good}, good),
                 "lrhs: layout is 7", "SHADER_READ_ONLY_OPTIMAL");
  bad = good;
  bad.value_scale = std::numeric_limits<float>::infinity();
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, good, {bad, good, good}, good), "hrls",
                 "value_scale is inf");
  bad = good;
  --bad.struct_size;
  EXPECT_FAILURE(RAYMELD_ERROR_INVALID_ARGUMENT, run(fusion, good, {good, bad, good}, good),
                 "hrls[1]: struct_size");

  raymeld_context_desc without = context_desc(caller_.external());
  without.enabled_features &= ~uint32_t{RAYMELD_FEATURE_IMAGE_WRITES};
  EXPECT_FAILURE(RAYMELD_ERROR_DEVICE, Fusion(Context(without), *model_, image_desc(subject)),
                 "shaderStorageImageWriteWithoutFormat");
}

}  // namespace
}  // namespace raymeld::test
