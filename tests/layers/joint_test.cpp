#include <gtest/gtest.h>

#include "shapes.h"

// Checks what the layers of the joint base refuse. Their results are checked by src/conform.
namespace raymeld::test {
namespace {

TEST(Joint, WrongShapesAreErrors) {
  const Shape low{2, 3, 3}, full{8, 12, 3}, full_1{8, 12, 1}, full_4{8, 12, 4}, full_5{8, 12, 5},
      low_6{2, 3, 6};
  const JointOptions options{.transfer = Transfer::kLog, .scale = 4};
  const char* name = "odd one";
  expect_only({low, full, full, low}, [&](Graph& graph, const std::vector<Tensor>& t) {
    irradiance(graph, name, t[0], t[1], t[2], t[3], options);
  });
  expect_only({full, full, low_6, full_5}, [&](Graph& graph, const std::vector<Tensor>& t) {
    demodulate(graph, name, t[0], t[1], t[2], t[3], options);
  });
  expect_only({full_4, full, full, full_1, full_4}, [&](Graph& graph, const std::vector<Tensor>& t) {
    joint_filter(graph, name, t[0], t[1], t[2], t[3], t[4], 2);
  });
  expect_only({full, full, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    remodulate(graph, name, t[0], t[1], t[2], Transfer::kLog);
  });
  expect_only({{8, 12, 8}, low_6, full, {8, 12, 9}, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    mix(graph, name, t[0], t[1], t[2], t[3], t[4], options);
  });
}

TEST(Joint, StepsArePowersOfTwo) {
  for (const uint32_t step : {0u, 3u, 12u}) {
    Graph graph(Storage::kFloat32);
    const Tensor image = graph.input("image", {8, 12, 4}), guide = image.slice(0, 3);
    EXPECT_ERROR(joint_filter(graph, "odd one", image, guide, guide, image.slice(3, 1),
                              graph.tensor("out", {8, 12, 4}), step),
                 "odd one", fmt::format("{} pixels", step));
  }
}

}  // namespace
}  // namespace raymeld::test
