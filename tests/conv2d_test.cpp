#include <gtest/gtest.h>

#include <cfloat>
#include <cmath>
#include <limits>

#include "gpu.h"

namespace raymeld::test {
namespace {

using reference::Bounded;
using reference::Conv;
using reference::exact;
using reference::Planes;
using reference::Precision;
using reference::within_bounds;

class Conv2dTest : public GpuTest {};

// How a convolution is computed: by which kernel, with activations in buffers or by address.
struct How {
  Conv2dKernel kernel;
  bool addressed = false;
};

// Every one that the device can, with chunks and bands so small that there are several of them.
std::vector<How> ways(uint32_t size) {
  std::vector<How> result{{}};
  if (!gpu().info().buffer_device_address) return result;
  for (const bool addressed : {false, true}) {
    for (const uint32_t tile : size == 1 ? std::vector<uint32_t>{1} : std::vector<uint32_t>{2, 4})
      result.push_back({{.tile = tile, .outputs = 5, .channels = 4, .order = 2, .band = 12}, addressed});
  }
  return result;
}

std::string describe(const How& how, uint32_t size) {
  if (how.kernel.tile == 0) return "direct";
  return fmt::format("F({}, {}){}", how.kernel.tile, size, how.addressed ? " by address" : "");
}

struct Case {
  int in, out, kernel;
  bool relu;
  int residuals;
  int behind = 0;  // of the input channels, in a tensor of their own
};

// Odd channel counts around the shader's blocks of 4 and 8, every kernel with every number of residuals.
constexpr Case kCases[] = {
    {1, 1, 3, false, 0},     {3, 8, 3, true, 0},   {4, 3, 1, false, 3},  {5, 9, 3, true, 1},
    {8, 4, 1, true, 2},      {9, 5, 3, false, 2},  {18, 8, 3, true, 0},  {7, 17, 1, false, 1},
    {2, 16, 3, true, 3},     {24, 3, 3, false, 0}, {16, 12, 1, true, 0}, {9, 5, 3, true, 1, 4},
    {11, 9, 1, false, 1, 7},
};

std::string describe(const Case& c, const Size& size, Precision precision) {
  return fmt::format(
      "{} -> {} channels, {} in a second tensor, kernel {}, relu {}, {} residuals, {} x {}, {}", c.in, c.out,
      c.behind, c.kernel, c.relu, c.residuals, size.h, size.w, name_of(precision));
}

Planes channels(const Planes& p, int first, int count) {
  const auto begin = p.data.begin() + ptrdiff_t(p.index(first, 0, 0));
  return Planes(count, p.h, p.w, {begin, begin + ptrdiff_t(p.index(count, 0, 0))});
}

struct Result {
  Planes device;
  Bounded expected;
};

Result run_case(const Case& c, const Size& size, Precision precision, Fill fill, uint64_t seed,
                const How& how) {
  const Conv conv = round_to(random_conv(c.out, c.in, c.kernel, fill, seed), precision);
  const Planes x = round_to(random_planes(c.in, size.h, size.w, fill, seed + 1), precision);
  LayerRun run(precision, how.addressed);
  const Tensor in = run.input("in", channels(x, 0, c.in - c.behind));
  const Tensor out = run.tensor("out", c.out, size.h, size.w);
  std::optional<Tensor> behind;
  if (c.behind > 0) behind = run.input("behind", channels(x, c.in - c.behind, c.behind));
  std::vector<Tensor> residuals;
  std::vector<Bounded> bounded;
  for (int i = 0; i < c.residuals; ++i) {
    const Planes values = round_to(random_planes(c.out, size.h, size.w, fill, seed + 2 + i), precision);
    residuals.push_back(run.input(fmt::format("residual {}", i), values));
    bounded.push_back(exact(values));
  }
  conv2d(run.graph(), "conv", in, out, run.weights(conv),
         {.kernel = uint32_t(c.kernel),
          .relu = c.relu,
          .residuals = residuals,
          .behind = behind,
          .how = how.kernel});
  run.run();
  std::vector<const Bounded*> pointers;
  for (const Bounded& b : bounded) pointers.push_back(&b);
  return {run.read(out),
          reference::conv2d(exact(x), conv, c.relu, precision, pointers, int(how.kernel.tile))};
}

// Every size with one case, every case with some sizes.
template <typename Check>
void for_each_case(Fill fill, Check&& check) {
  size_t next = 0;
  for (const Precision precision : kPrecisions) {
    for (const Size& size : awkward_sizes()) {
      const Case& c = kCases[next++ % std::size(kCases)];
      for (const How& how : ways(uint32_t(c.kernel))) {
        SCOPED_TRACE(describe(c, size, precision) + ", " + describe(how, uint32_t(c.kernel)));
        check(run_case(c, size, precision, fill, next, how), precision, how);
      }
    }
  }
}

TEST_F(Conv2dTest, SmallIntegersAreExact) {
  for_each_case(Fill::kIntegers, [](const Result& result, Precision, const How& how) {
    if (how.kernel.tile == 4) return;  // its weights are divided by 3
    EXPECT_TRUE(within_bounds("conv2d", result.device, exact(result.expected.value)));
  });
}

TEST_F(Conv2dTest, RandomValuesKeepTheBounds) {
  for_each_case(Fill::kUniform, [](const Result& result, Precision precision, const How& how) {
    const std::string name = how.kernel.tile
                                 ? fmt::format("conv2d F({}) {}", how.kernel.tile, name_of(precision))
                                 : "conv2d " + name_of(precision);
    EXPECT_TRUE(within_bounds(name, result.device, result.expected));
  });
}

TEST_F(Conv2dTest, ReadsAndWritesSlicesOfOneTensor) {
  for (const Precision precision : kPrecisions) {
    for (const How& how : ways(3)) {
      SCOPED_TRACE(name_of(precision) + ", " + describe(how, 3));
      const Planes wide = round_to(random_planes(13, 9, 7, Fill::kUniform, 1), precision);
      const Conv conv = round_to(random_conv(3, 5, 3, Fill::kUniform, 2), precision);
      LayerRun run(precision, how.addressed);
      const Tensor all = run.input("features", wide);
      conv2d(run.graph(), "dense", all.slice(2, 5), all.slice(8, 3), run.weights(conv),
             {.kernel = 3, .how = how.kernel});
      run.run();

      const Planes after = run.read(all);
      EXPECT_TRUE(within_bounds(
          "slices", channels(after, 8, 3),
          reference::conv2d(exact(channels(wide, 2, 5)), conv, false, precision, {}, int(how.kernel.tile))));
      EXPECT_EQ(channels(after, 0, 8).data, channels(wide, 0, 8).data);
      EXPECT_EQ(channels(after, 11, 2).data, channels(wide, 11, 2).data);
    }
  }
}

// out = in * weight + bias, one pixel after another.
std::vector<float> pointwise(const std::vector<float>& in, float weight, float bias, bool relu,
                             Precision precision, Status& status) {
  LayerRun run(precision);
  const Tensor x = run.input("in", planes(1, 1, int(in.size()), in));
  const Tensor y = run.tensor("out", 1, 1, int(in.size()));
  conv2d(run.graph(), "conv", x, y, run.weights({1, 1, 1, {weight}, {bias}}), {.kernel = 1, .relu = relu});
  run.run();
  status = run.status();
  return floats(run.read(y));
}

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

TEST_F(Conv2dTest, SpecialsInFp32PassWithoutChange) {
  const std::vector<float> in{-0.0f,   FLT_MIN,  65519,     65520,      1e8f, 1e30f,
                              FLT_MAX, -FLT_MAX, kInfinity, -kInfinity, kNaN};
  Status status;
  const std::vector<float> out = pointwise(in, 1, 0, false, Precision::kFp32, status);
  for (size_t i = 0; i < in.size(); ++i) {
    EXPECT_TRUE(out[i] == in[i] || (std::isnan(out[i]) && std::isnan(in[i]))) << in[i] << " gave " << out[i];
  }
  EXPECT_EQ(status.saturated, 0u);
}

TEST_F(Conv2dTest, DenormalsAreKeptOrFlushed) {
  Status status;
  for (const float out : pointwise({1e-40f, -1e-40f, FLT_TRUE_MIN}, 1, 0, false, Precision::kFp32, status)) {
    EXPECT_LT(std::abs(out), FLT_MIN);
  }
  const std::vector<float> in{0x1p-24f, -0x1p-15f, 0x1.8p-16f};  // subnormal as halves
  EXPECT_EQ(pointwise(in, 1, 0, false, Precision::kFp16, status), in);
}

TEST_F(Conv2dTest, Fp16StoresSaturateAndAreCounted) {
  Status status;
  EXPECT_EQ(pointwise({65504, -65504, 60000}, 1, 0, false, Precision::kFp16, status),
            (std::vector<float>{65504, -65504, 60000}));
  EXPECT_EQ(status.saturated, 0u);
  EXPECT_EQ(pointwise({65504, -65504, 40000, 2}, 2, 0, false, Precision::kFp16, status),
            (std::vector<float>{65504, -65504, 65504, 4}));
  EXPECT_EQ(status.saturated, 3u);
  EXPECT_EQ(pointwise({65504, 65504 - 32}, 1, 15, false, Precision::kFp16, status),  // 65519, 65487
            (std::vector<float>{65504, 65472}));
  EXPECT_EQ(status.saturated, 1u);
  EXPECT_EQ(pointwise({kInfinity, -kInfinity}, 1, 0, false, Precision::kFp16, status),
            (std::vector<float>{65504, -65504}));
  EXPECT_EQ(status.saturated, 2u);
}

// A NaN that ReLU dropped would hide an overflow from the count in decode.
TEST_F(Conv2dTest, ReluCutsBelowZeroAndKeepsNaN) {
  for (const Precision precision : kPrecisions) {
    SCOPED_TRACE(name_of(precision));
    Status status;
    const std::vector<float> out = pointwise({-1, -0.0f, 3, kNaN, -kNaN}, 1, 0, true, precision, status);
    EXPECT_EQ(out[0], 0);
    EXPECT_EQ(out[1], 0);
    EXPECT_EQ(out[2], 3);
    EXPECT_TRUE(std::isnan(out[3])) << out[3];
    EXPECT_TRUE(std::isnan(out[4])) << out[4];
  }
}

// Padding and the tails of tiles read nothing of a poisoned pixel, wherever that lies.
TEST_F(Conv2dTest, APoisonedPixelStaysInItsNeighbourhood) {
  const Planes clean = random_planes(5, 11, 35, Fill::kUniform, 3);
  const Conv conv = random_conv(9, 5, 3, Fill::kUniform, 4);
  const auto run_on = [&](const Planes& image) {
    LayerRun run(Precision::kFp32);
    const Tensor in = run.input("in", image), out = run.tensor("out", 9, 11, 35);
    conv2d(run.graph(), "conv", in, out, run.weights(conv), {.kernel = 3, .relu = true});
    run.run();
    return run.read(out);
  };
  const Planes expected = run_on(clean);
  for (const auto& [y, x] : {std::pair(0, 0), {10, 34}, {4, 32}, {3, 0}}) {
    for (const float poison : {1e8f, 1e30f, FLT_MAX, kInfinity, kNaN}) {
      Planes image = clean;
      image.at(2, y, x) = poison;
      const Planes out = run_on(image);
      size_t changed_far = 0, changed_near = 0;
      for (int c = 0; c < out.c; ++c) {
        for (int v = 0; v < out.h; ++v) {
          for (int u = 0; u < out.w; ++u) {
            const bool same = out.at(c, v, u) == expected.at(c, v, u);
            const bool near = std::abs(v - y) <= 1 && std::abs(u - x) <= 1;
            (near ? changed_near : changed_far) += !same;
          }
        }
      }
      EXPECT_EQ(changed_far, 0u) << poison << " at " << y << ", " << x;
      EXPECT_GT(changed_near, 0u) << poison << " at " << y << ", " << x;
    }
  }
}

}  // namespace
}  // namespace raymeld::test
