#include <gtest/gtest.h>

#include <cfloat>
#include <cmath>
#include <limits>

#include "error_of.h"
#include "gpu.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Bounded;
using reference::Conv;
using reference::exact;
using reference::Planes;
using reference::Precision;

class Conv2dTest : public GpuTest {};

// How a convolution is computed: by which kernel, with activations in buffers or by address.
struct How {
  Conv2dKernel kernel;
  bool addressed = false;
};

// Every one that the device can, with chunks, blocks and bands so small that there are several of them.
std::vector<How> ways(uint32_t size, Precision precision) {
  std::vector<How> result{{}};
  if (const auto& matrix = gpu().info().cooperative_matrix; matrix && precision == Precision::kFp16) {
    const auto [m, n, k] = std::tuple(matrix->m, matrix->n, matrix->k);
    for (const MatrixTiles& tiles :
         {MatrixTiles{*matrix, m, 1, 2, k}, MatrixTiles{*matrix, 2 * m, 2, 1, 2 * k}})
      result.push_back({{.matrix = tiles}});
  }
  if (!gpu().info().buffer_device_address) return result;
  for (const bool addressed : {false, true}) {
    for (const uint32_t tile : size == 1 ? std::vector<uint32_t>{1} : std::vector<uint32_t>{2, 4})
      result.push_back({{.tile = tile, .outputs = 5, .channels = 4, .order = 2, .band = 12}, addressed});
  }
  return result;
}

std::string describe(const How& how, uint32_t size) {
  if (how.kernel.matrix) return fmt::format("matrix, {} outputs", how.kernel.matrix->outputs);
  if (how.kernel.tile == 0) return "direct";
  return fmt::format("F({}, {}){}", how.kernel.tile, size, how.addressed ? " by address" : "");
}

Bounded expected_conv2d(const Bounded& x, const Conv& conv, bool relu, Precision precision,
                        const std::vector<const Bounded*>& residuals, const How& how) {
  return reference::conv2d(x, conv, relu, precision, residuals, int(how.kernel.tile),
                           how.kernel.matrix ? reference::kMatrixUnits : 1);
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
  return {run.read(out), expected_conv2d(exact(x), conv, c.relu, precision, pointers, how)};
}

// Every size with one case, every case with some sizes.
template <typename Check>
void for_each_case(Fill fill, Check&& check) {
  size_t next = 0;
  for (const Precision precision : kPrecisions) {
    for (const Size& size : awkward_sizes()) {
      const Case& c = kCases[next++ % std::size(kCases)];
      for (const How& how : ways(uint32_t(c.kernel), precision)) {
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
    const std::string kind = how.kernel.matrix ? "matrix "
                             : how.kernel.tile ? fmt::format("F({}) ", how.kernel.tile)
                                               : "";
    const std::string name = "conv2d " + kind + name_of(precision);
    EXPECT_TRUE(within_bounds(name, result.device, result.expected));
  });
}

TEST_F(Conv2dTest, ReadsAndWritesSlicesOfOneTensor) {
  for (const Precision precision : kPrecisions) {
    for (const How& how : ways(3, precision)) {
      SCOPED_TRACE(name_of(precision) + ", " + describe(how, 3));
      const Planes wide = round_to(random_planes(13, 9, 7, Fill::kUniform, 1), precision);
      const Conv conv = round_to(random_conv(3, 5, 3, Fill::kUniform, 2), precision);
      LayerRun run(precision, how.addressed);
      const Tensor all = run.input("features", wide);
      conv2d(run.graph(), "dense", all.slice(2, 5), all.slice(8, 3), run.weights(conv),
             {.kernel = 3, .how = how.kernel});
      run.run();

      const Planes after = run.read(all);
      EXPECT_TRUE(
          within_bounds("slices", channels(after, 8, 3),
                        expected_conv2d(exact(channels(wide, 2, 5)), conv, false, precision, {}, how)));
      EXPECT_EQ(channels(after, 0, 8).data, channels(wide, 0, 8).data);
      EXPECT_EQ(channels(after, 11, 2).data, channels(wide, 11, 2).data);
    }
  }
}

// Of an unshuffled image, to be shuffled; with residuals where the shuffle is no pass of its own.
TEST_F(Conv2dTest, ReadsAndWritesShuffled) {
  const int r = 2, in_channels = 2, out_channels = 3, h = 5, w = 35;
  for (const Precision precision : kPrecisions) {
    for (const How& how : ways(3, precision)) {
      SCOPED_TRACE(name_of(precision) + ", " + describe(how, 3));
      const Planes x = round_to(random_planes(in_channels, r * h, r * w, Fill::kUniform, 1), precision);
      const Planes y = round_to(random_planes(out_channels, r * h, r * w, Fill::kUniform, 2), precision);
      const Conv conv =
          round_to(random_conv(r * r * out_channels, r * r * in_channels, 3, Fill::kUniform, 3), precision);
      LayerRun run(precision, how.addressed);
      const Tensor in = run.input("in", x), out = run.tensor("out", out_channels, r * h, r * w);
      std::vector<Tensor> residuals;
      Bounded before;
      std::vector<const Bounded*> bounded;
      if (how.kernel.tile > 0 || how.kernel.matrix) {
        residuals.push_back(run.input("residual", y));
        before = reference::space_to_depth(exact(y), r);
        bounded.push_back(&before);
      }
      conv2d(run.graph(), "conv", in, out, run.weights(conv),
             {.kernel = 3,
              .relu = true,
              .residuals = residuals,
              .unshuffle = r,
              .shuffle = r,
              .how = how.kernel});
      run.run();
      const Bounded deep = reference::space_to_depth(exact(x), r);
      EXPECT_TRUE(within_bounds(
          "shuffled", run.read(out),
          reference::pixel_shuffle(expected_conv2d(deep, conv, true, precision, bounded, how), r)));
    }
  }
}

// out = in * weight + bias, one pixel after another.
std::vector<float> pointwise(const std::vector<float>& in, float weight, float bias, bool relu,
                             Precision precision, Status& status, const How& how = {}) {
  LayerRun run(precision);
  const Tensor x = run.input("in", planes(1, 1, int(in.size()), in));
  const Tensor y = run.tensor("out", 1, 1, int(in.size()));
  conv2d(run.graph(), "conv", x, y, run.weights({1, 1, 1, {weight}, {bias}}),
         {.kernel = 1, .relu = relu, .how = how.kernel});
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

// Those with direct sums, which promise more than bounds.
std::vector<How> direct_ways(uint32_t size, Precision precision) {
  std::vector<How> result = ways(size, precision);
  std::erase_if(result, [](const How& how) { return how.kernel.tile > 0; });
  return result;
}

TEST_F(Conv2dTest, Fp16StoresSaturateAndAreCounted) {
  for (const How& how : direct_ways(1, Precision::kFp16)) {
    SCOPED_TRACE(describe(how, 1));
    Status status;
    const auto stored = [&](const std::vector<float>& in, float weight, float bias) {
      return pointwise(in, weight, bias, false, Precision::kFp16, status, how);
    };
    EXPECT_EQ(stored({65504, -65504, 60000}, 1, 0), (std::vector<float>{65504, -65504, 60000}));
    EXPECT_EQ(status.saturated, 0u);
    EXPECT_EQ(stored({65504, -65504, 40000, 2}, 2, 0), (std::vector<float>{65504, -65504, 65504, 4}));
    EXPECT_EQ(status.saturated, 3u);
    EXPECT_EQ(stored({65504, 65504 - 32}, 1, 15), (std::vector<float>{65504, 65472}));  // 65519, 65487
    EXPECT_EQ(status.saturated, 1u);
    EXPECT_EQ(stored({kInfinity, -kInfinity}, 1, 0), (std::vector<float>{65504, -65504}));
    EXPECT_EQ(status.saturated, 2u);
  }
}

// A NaN that ReLU dropped would hide an overflow from the count in decode.
TEST_F(Conv2dTest, ReluCutsBelowZeroAndKeepsNaN) {
  for (const Precision precision : kPrecisions) {
    for (const How& how : direct_ways(1, precision)) {
      SCOPED_TRACE(name_of(precision) + ", " + describe(how, 1));
      Status status;
      const std::vector<float> out =
          pointwise({-1, -0.0f, 3, kNaN, -kNaN}, 1, 0, true, precision, status, how);
      EXPECT_EQ(out[0], 0);
      EXPECT_EQ(out[1], 0);
      EXPECT_EQ(out[2], 3);
      EXPECT_TRUE(std::isnan(out[3])) << out[3];
      EXPECT_TRUE(std::isnan(out[4])) << out[4];
    }
  }
}

// Padding and the tails of tiles read nothing of a poisoned pixel, wherever that lies.
TEST_F(Conv2dTest, APoisonedPixelStaysInItsNeighbourhood) {
  const Conv conv = random_conv(9, 5, 3, Fill::kUniform, 4);
  for (const Precision precision : kPrecisions) {
    const Planes clean = round_to(random_planes(5, 11, 35, Fill::kUniform, 3), precision);
    for (const How& how : direct_ways(3, precision)) {
      SCOPED_TRACE(name_of(precision) + ", " + describe(how, 3));
      const auto run_on = [&](const Planes& image) {
        LayerRun run(precision);
        const Tensor in = run.input("in", image), out = run.tensor("out", 9, 11, 35);
        conv2d(run.graph(), "conv", in, out, run.weights(conv),
               {.kernel = 3, .relu = true, .how = how.kernel});
        run.run();
        return run.read(out);
      };
      const Planes expected = run_on(clean);
      const bool is_half = precision == Precision::kFp16;
      const std::vector<float> poisons = is_half ? std::vector<float>{6e4f, kInfinity, kNaN}
                                                 : std::vector<float>{1e8f, 1e30f, FLT_MAX, kInfinity, kNaN};
      for (const auto& [y, x] : {std::pair(0, 0), {10, 34}, {4, 32}, {3, 0}}) {
        for (const float poison : poisons) {
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
  }
}

// Nothing of this needs a device that has them.
TEST(MatrixTiles, MustBeWholeMatricesAndFitSharedMemory) {
  const CooperativeMatrix matrix{16, 8, 16, 32, 1024, 49152};
  EXPECT_TRUE(is_possible({matrix}, 3));
  EXPECT_TRUE(is_possible({.matrix = matrix, .channels = 32}, 1));
  EXPECT_FALSE(is_possible({.matrix = matrix, .channels = 32}, 3));  // 64 KiB
  EXPECT_FALSE(is_possible({.matrix = matrix, .outputs = 24}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .channels = 8}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .rows = 0}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .outputs = 16, .rows = 1, .subgroups = 64}, 1));
  EXPECT_FALSE(is_possible({.matrix = {16, 12, 16, 32, 1024, 49152}}, 3));
  EXPECT_FALSE(is_possible({.matrix = {16, 8, 16, 32, 64, 49152}}, 3));
  EXPECT_FALSE(is_possible({.matrix = {16, 8, 16, 32, 1024, 16384}}, 3));
}

TEST_F(Conv2dTest, MatricesAreRefusedWhereTheyCannotBe) {
  const MatrixTiles tiles{.matrix = {16, 16, 16, 32, 1024, 1u << 17}};  // no device has so much
  const std::vector<float> weight(9, 1.0f), bias(1, 0.0f);
  const auto add = [&](Graph& graph, const MatrixTiles& with) {
    const Tensor in = graph.input("in", {4, 4, 1}), out = graph.tensor("out", {4, 4, 1});
    conv2d(graph, "conv", in, out, {weight, bias}, {.how = {.matrix = with}});
    graph.plan();
  };
  Graph full(Storage::kFloat32), half(Storage::kFloat16), odd(Storage::kFloat16);
  EXPECT_ERROR(add(full, tiles), "layer conv", "16-bit storage");
  EXPECT_ERROR(add(odd, {.matrix = tiles.matrix, .outputs = 17}), "layer conv", "impossible");
  add(half, tiles);
  EXPECT_ERROR(Program(gpu(), half, shared_cache(), 1), "layer conv",
               "no such cooperative matrices of 16x16x16");
}

}  // namespace
}  // namespace raymeld::test
