#include <gtest/gtest.h>

#include "gpu.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Bounded;
using reference::LayerKind;
using reference::Planes;
using reference::Precision;

class EncodeTest : public GpuTest {};

ChannelKind kind_of(LayerKind kind) {
  switch (kind) {
    case LayerKind::kAlbedo:
      return ChannelKind::kAlbedo;
    case LayerKind::kNormal:
      return ChannelKind::kNormal;
    case LayerKind::kVariance:
      return ChannelKind::kVariance;
    default:
      return ChannelKind::kRadiance;
  }
}

// Radiance from 0 to beyond the clip, albedo and normals beyond their ranges, specials in between.
Planes image_of(LayerKind kind, const Size& size, uint64_t seed) {
  Planes image = random_planes(3, size.h, size.w, Fill::kSpecials, seed);
  if (kind != LayerKind::kRadiance && kind != LayerKind::kVariance) return image;
  for (size_t i = 0; i < image.data.size(); ++i) {
    if (image.data[i] > -1 && image.data[i] < 1) image.data[i] = float(image.data[i] * (i % 2 ? 1 : 150));
  }
  return image;
}

struct Encoded {
  Planes device;
  size_t touched_outside;
};

Encoded encode_on_gpu(const Planes& image, const std::vector<ChannelKind>& kinds, Transfer transfer,
                      float clip, Precision precision, const FrameImage::Layout& layout, float exposure = 1) {
  const FrameImage frame(gpu(), image, layout);
  LayerRun run(precision);
  const Tensor out = run.tensor("out", image.c, image.h, image.w);
  encode(run.graph(), "encode", FrameSlot::kHrls, out, kinds, transfer, clip);
  run.run({FrameBinding{}, frame.binding(), FrameBinding{}}, exposure);
  return {run.read(out), frame.touched_outside()};
}

TEST_F(EncodeTest, EveryKindTransferAndLayout) {
  size_t next = 0;
  for (const Precision precision : kPrecisions) {
    for (const bool log : {false, true}) {
      for (const Size& size : awkward_sizes()) {
        const float clip = log ? 1000.0f : 100.0f;
        const float exposure = std::array{1.0f, 0.013f, 770.0f, 0x1p-24f, 0x1p24f}[next % 5];
        const FrameImage::Layout& layout = frame_layouts()[next++ % frame_layouts().size()];
        SCOPED_TRACE(fmt::format("{}, {}, {} x {}, layout {}", name_of(precision), log ? "log" : "linear",
                                 size.h, size.w, (next - 1) % frame_layouts().size()));
        Planes image(0, size.h, size.w);
        Bounded expected;
        std::vector<ChannelKind> kinds;
        for (const LayerKind kind :
             {LayerKind::kRadiance, LayerKind::kAlbedo, LayerKind::kNormal, LayerKind::kVariance}) {
          const Planes layer = image_of(kind, size, next + 7 * kinds.size());
          const Bounded one =
              reference::encode(layer, kind, log ? reference::Transfer::kLog : reference::Transfer::kLinear,
                                clip, precision, exposure);
          expected = kinds.empty() ? one : reference::concat(expected, one);
          image.data.insert(image.data.end(), layer.data.begin(), layer.data.end());
          image.c += 3;
          kinds.insert(kinds.end(), 3, kind_of(kind));
        }
        const Encoded result = encode_on_gpu(image, kinds, log ? Transfer::kLog : Transfer::kLinear, clip,
                                             precision, layout, exposure);
        EXPECT_TRUE(within_bounds(fmt::format("encode {} {}", log ? "log" : "linear", name_of(precision)),
                                  result.device, expected));
        EXPECT_EQ(result.touched_outside, 0u);
      }
    }
  }
}

TEST_F(EncodeTest, SanitisesAsStated) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  const Planes row(1, 1, 8, {kNaN, -kNaN, kInfinity, -kInfinity, 1e30, -1e30, -0.5, 0.25});
  Planes image = row;
  for (int c = 1; c < 3; ++c) image.data.insert(image.data.end(), row.data.begin(), row.data.end());
  image.c = 3;
  const Planes expected(3, 1, 8, {0, 0, 50, 0,  50, 0,  0,    0.25,  // radiance
                                  0, 0, 1,  0,  1,  0,  0,    0.25,  // albedo
                                  0, 0, 1,  -1, 1,  -1, -0.5, 0.25});
  for (const Precision precision : kPrecisions) {
    const Encoded result =
        encode_on_gpu(image, {ChannelKind::kRadiance, ChannelKind::kAlbedo, ChannelKind::kNormal},
                      Transfer::kLinear, 50, precision, {});
    EXPECT_EQ(result.device.data, expected.data) << name_of(precision);
  }
}

}  // namespace
}  // namespace raymeld::test
