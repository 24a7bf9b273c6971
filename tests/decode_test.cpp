#include <gtest/gtest.h>

#include <limits>

#include "gpu.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;

class DecodeTest : public GpuTest {};

struct Options {
  bool log = false, bilinear = false;
  int scale = 2;
  float phase = 0;
  float exposure = 1;
};

struct Decoded {
  Planes device;
  size_t touched_outside;
  Status status;
};

Decoded decode_on_gpu(const Planes& rec, const Planes* base, const Options& options, Precision precision,
                      const FrameImage::Layout& layout) {
  const Shape shape{uint32_t(rec.h), uint32_t(rec.w), uint32_t(rec.c)};
  const FrameImage frame(gpu(), shape, Memory::kReadback, layout);
  LayerRun run(precision);
  const Tensor in = run.input("rec", rec);
  Tensor lrhs;
  if (base) lrhs = run.input("lrhs", *base);
  decode(run.graph(), "decode", in,
         {options.log ? Transfer::kLog : Transfer::kLinear, base ? &lrhs : nullptr, uint32_t(options.scale),
          options.phase});
  run.run({FrameBinding{}, FrameBinding{}, frame.binding()}, options.exposure);
  return {frame.read(), frame.touched_outside(), run.status()};
}

void check(const Size& size, const Options& options, Precision precision, const FrameImage::Layout& layout,
           uint64_t seed) {
  Planes rec = random_planes(3, size.h * options.scale, size.w * options.scale, Fill::kUniform, seed);
  for (double& v : rec.data) v *= options.log ? 3 : 100;
  rec = round_to(rec, precision);
  const Planes base = round_to(random_planes(3, size.h, size.w, Fill::kUniform, seed + 1), precision);
  const Bounded upsampled = reference::bilinear(exact(base), options.scale, options.phase);
  const Decoded result = decode_on_gpu(rec, options.bilinear ? &base : nullptr, options, precision, layout);
  const Bounded expected =
      reference::decode(exact(rec), options.bilinear ? &upsampled : nullptr,
                        options.log ? reference::Transfer::kLog : reference::Transfer::kLinear,
                        Precision::kFp32, options.exposure);
  EXPECT_TRUE(within_bounds(
      fmt::format("decode {} {}", options.log ? "log" : "linear", options.bilinear ? "bilinear" : "none"),
      result.device, expected));
  EXPECT_EQ(result.touched_outside, 0u);
  EXPECT_EQ(result.status.not_finite, 0u);
}

TEST_F(DecodeTest, EveryTransferBaseScalePhaseAndLayout) {
  uint64_t next = 0;
  for (const Precision precision : kPrecisions) {
    for (const int scale : {2, 4, 8}) {
      for (const bool log : {false, true}) {
        for (const auto& [bilinear, phase] :
             {std::pair(false, 0.0f), {true, 0.0f}, {true, (float(scale) - 1) / 2}}) {
          const Size& size = awkward_sizes()[next % 8];
          const FrameImage::Layout& layout = frame_layouts()[next++ % frame_layouts().size()];
          SCOPED_TRACE(fmt::format("{}, x{}, {}, {}, phase {}, {} x {}", name_of(precision), scale,
                                   log ? "log" : "linear", bilinear ? "bilinear" : "none", phase, size.h,
                                   size.w));
          const float exposure = std::array{1.0f, 0.013f, 770.0f}[next % 3];
          check(size, {log, bilinear, scale, phase, exposure}, precision, layout, next);
        }
      }
    }
  }
}

// A ramp of samples at X = s i + phase is reproduced between the samples and held beyond them.
TEST_F(DecodeTest, BilinearBaseReproducesARamp) {
  for (const float phase : {0.0f, 1.5f}) {
    const Planes base(1, 1, 3, {4 * 0 + phase, 4 * 1 + phase, 4 * 2 + phase});
    const Decoded result =
        decode_on_gpu(Planes(1, 4, 12), &base, {false, true, 4, phase}, Precision::kFp32, {});
    for (int x = 0; x < 12; ++x) {
      EXPECT_EQ(result.device.at(0, 2, x), std::clamp(double(x), double(phase), 8.0 + phase)) << phase;
    }
  }
}

TEST_F(DecodeTest, NotFiniteBecomesZeroAndIsCounted) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (const bool log : {false, true}) {
    const Planes rec(1, 1, 8, {kNaN, -kNaN, kInfinity, -kInfinity, 0, 1, -1, 2});
    for (const Precision precision : kPrecisions) {
      SCOPED_TRACE(fmt::format("{} {}", log ? "log" : "linear", name_of(precision)));
      const Decoded result = decode_on_gpu(rec, nullptr, {.log = log}, precision, {});
      EXPECT_EQ(result.status.not_finite, 4u);
      for (const int x : {0, 1, 2, 3, 4, 6}) EXPECT_EQ(result.device.at(0, 0, x), 0) << x;
      EXPECT_GT(result.device.at(0, 0, 5), 0);
    }
  }
}

// What the output holds is limited after the exposure is undone, so that none of the range is lost.
TEST_F(DecodeTest, AnyExposureLeavesTheRangeOfHalf) {
  for (const float exposure : {0x1p-24f, 0x1p-7f, 1.0f, 0x1p7f, 0x1p24f}) {
    for (const bool log : {false, true}) {
      Planes rec(1, 1, 4);
      const std::array radiance{0.25, 60000.0, 65504.0, 1e6};
      for (size_t i = 0; i < radiance.size(); ++i) {
        const double exposed = radiance[i] * exposure;
        rec.data[i] = float(log ? std::log1p(8 * exposed) / 3 : exposed);
      }
      const Options options{.log = log, .exposure = exposure};
      const Planes decoded = decode_on_gpu(rec, nullptr, options, Precision::kFp32, {}).device;
      SCOPED_TRACE(fmt::format("{}, exposure {}", log ? "log" : "linear", exposure));
      // Near 0 log(1 + 8 x) keeps no more of x than 1 + 8 x does.
      for (size_t i = 0; i < 3; ++i)
        EXPECT_NEAR(decoded.data[i], radiance[i], 2e-5 * radiance[i] + (log ? 2e-7 / exposure : 0));
      EXPECT_EQ(decoded.data[3], 65504);
    }
  }
}

TEST_F(DecodeTest, ClampsToTheRangeOfHalf) {
  const Planes rec(1, 1, 5, {1e8, 3e38, -1e8, 65504, 65505});
  EXPECT_EQ(decode_on_gpu(rec, nullptr, {}, Precision::kFp32, {}).device.data,
            (std::vector<double>{65504, 65504, 0, 65504, 65504}));
  const Planes logs(1, 1, 4, {4.4, 1e8, 3e38, -1e8});
  EXPECT_EQ(decode_on_gpu(logs, nullptr, {.log = true}, Precision::kFp32, {}).device.data,
            (std::vector<double>{65504, 65504, 65504, 0}));
}

}  // namespace
}  // namespace raymeld::test
