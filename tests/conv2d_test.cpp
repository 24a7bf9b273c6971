#include <gtest/gtest.h>

#include "error_of.h"
#include "gpu.h"

// Tests what conv2d() refuses; src/conform checks what it computes.
namespace raymeld::test {
namespace {

class Conv2dTest : public GpuTest {};

// No device with cooperative matrices is needed here.
TEST(MatrixTiles, MustBeWholeMatricesAndFitSharedMemory) {
  const CooperativeMatrix matrix{16, 8, 16, 32, 1024, 49152};
  EXPECT_TRUE(is_possible({matrix}, 3));
  EXPECT_TRUE(is_possible({.matrix = matrix, .channels = 32}, 1));
  EXPECT_FALSE(is_possible({.matrix = matrix, .channels = 32}, 3));  // takes 64 KiB of shared memory
  EXPECT_FALSE(is_possible({.matrix = matrix, .outputs = 24}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .channels = 8}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .rows = 0}, 3));
  EXPECT_FALSE(is_possible({.matrix = matrix, .outputs = 16, .rows = 1, .subgroups = 64}, 1));
  EXPECT_FALSE(is_possible({.matrix = {16, 12, 16, 32, 1024, 49152}}, 3));
  EXPECT_FALSE(is_possible({.matrix = {16, 8, 16, 32, 64, 49152}}, 3));
  EXPECT_FALSE(is_possible({.matrix = {16, 8, 16, 32, 1024, 16384}}, 3));
}

TEST_F(Conv2dTest, MatricesAreRefusedWhereTheyCannotBe) {
  const MatrixTiles tiles{.matrix = {16, 16, 16, 32, 1024, 1u << 17}};  // no device has so much shared memory
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
  EXPECT_ERROR(Program(gpu(), half, shared_cache(), 1), "layer conv",
               "no such cooperative matrices of 16x16x16");
}

}  // namespace
}  // namespace raymeld::test
