#include <fmt/format.h>
#include <gtest/gtest.h>

#include "error_of.h"
#include "gpu.h"

// Tests what conv2d() refuses, and what a chain keeps; src/conform checks what it computes.
namespace raymeld::test {
namespace {

class Conv2dTest : public GpuTest {};

// No device with cooperative matrices is needed here.
TEST(MatrixTiles, MustBeWholeMatricesAndFitSharedMemory) {
  const CooperativeMatrix matrix{
      .m = 16, .n = 8, .k = 16, .subgroup_size = 32, .max_invocations = 1024, .max_shared_bytes = 49152};
  const auto with = [&](uint32_t CooperativeMatrix::*field, uint32_t value) {
    CooperativeMatrix other = matrix;
    other.*field = value;
    return MatrixTiles{.matrix = other};
  };
  EXPECT_TRUE(is_possible({matrix}, 3));
  EXPECT_TRUE(is_possible({.matrix = matrix, .channels = 32}, 1));
  EXPECT_FALSE(is_possible({.matrix = matrix, .channels = 32}, 3));  // takes 64 KiB of shared memory
  EXPECT_FALSE(is_possible({.matrix = matrix, .outputs = 24}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .channels = 8}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .rows = 0}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .outputs = 16, .rows = 1, .subgroups = 64}, 1));
  EXPECT_FALSE(is_possible(with(&CooperativeMatrix::n, 12), 3));
  EXPECT_FALSE(is_possible(with(&CooperativeMatrix::m, 4), 3));  // shuffled pixels need 8 outputs
  EXPECT_FALSE(is_possible(with(&CooperativeMatrix::max_invocations, 64), 3));
  EXPECT_FALSE(is_possible(with(&CooperativeMatrix::max_shared_bytes, 16384), 3));
}

TEST_F(Conv2dTest, MatricesAreRefusedWhereTheyCannotBe) {
  // No device has so much shared memory.
  const MatrixTiles tiles{.matrix = {.m = 16,
                                     .n = 16,
                                     .k = 16,
                                     .subgroup_size = 32,
                                     .max_invocations = 1024,
                                     .max_shared_bytes = 1u << 17}};
  const std::vector<float> weight(9, 1.0f), bias(1, 0.0f);
  const auto add = [&](Graph& graph, const MatrixTiles& with) {
    const Tensor in = graph.input("in", {4, 4, 1}), out = graph.tensor("out", {4, 4, 1});
    conv2d(graph, "conv", in, out, {weight, bias},
           {.how = {.algorithm = Algorithm::kMatrix, .matrix = with}});
    graph.plan();
  };
  Graph full(Storage::kFloat32), half(Storage::kFloat16), odd(Storage::kFloat16);
  EXPECT_ERROR(add(full, tiles), "layer conv", "16-bit storage");
  EXPECT_ERROR(add(odd, {.matrix = tiles.matrix, .outputs = 17}), "layer conv", "impossible");
  add(half, tiles);
  EXPECT_ERROR(Program(gpu(), half, shared_cache(), 1), "layer conv", "no cooperative matrices of 16x16x16");
}

TEST_F(Conv2dTest, AKernelOf5IsDirectOrByWinograd) {
  const std::vector<float> weight(50, 1.0f), bias(1, 0.0f);
  Graph graph(Storage::kFloat32);
  const Tensor two = graph.input("two", {4, 4, 2}), out = graph.tensor("out", {4, 4, 1});
  const auto add = [&](const Tensor& from, const Conv2dOptions& options) {
    conv2d(graph, "conv", from, out, {weight, bias}, options);
  };
  EXPECT_ERROR(add(two, {.kernel = 4}), "layer conv", "expected 1, 3 or 5");
  for (const Algorithm algorithm : {Algorithm::kPointwise, Algorithm::kColumns, Algorithm::kMatrix})
    EXPECT_ERROR(add(two, {.kernel = 5, .how = {.algorithm = algorithm}}), "layer conv", "the direct one");
  add(two, {.kernel = 5});
  add(two, {.kernel = 5, .how = {.algorithm = Algorithm::kWinograd}});
}

// The rows that a chain keeps of its tensors are those that a 3x3 reads.
TEST_F(Conv2dTest, AKernelOf5InAChainReadsAndWritesWholeImages) {
  const std::vector<float> weight(25, 1.0f), bias(1, 0.0f);
  for (const uint32_t kernel : {3u, 5u}) {
    Graph graph(Storage::kFloat32);
    std::vector<Tensor> tensors{graph.input("0", {64, 16, 1})};
    for (const char* name : {"1", "2", "3"}) tensors.push_back(graph.tensor(name, {64, 16, 1}));
    std::vector<Conv2dLink> links;
    for (const uint32_t i : {0u, 1u, 2u}) {
      const uint32_t side = i == 1 ? kernel : 3;
      const Conv2dOptions options{.kernel = side,
                                  .how = {.algorithm = Algorithm::kWinograd, .tile = 2, .band = 8}};
      links.push_back({fmt::format("conv {}", i),
                       tensors[i],
                       tensors[i + 1],
                       {std::span(weight).first(size_t{side} * side), bias},
                       options});
    }
    conv2d_chain(graph, links);
    for (const Tensor& between : {tensors[1], tensors[2]})
      EXPECT_EQ(graph.rows_mask(between) == UINT32_MAX, kernel == 5);
  }
}

}  // namespace
}  // namespace raymeld::test
