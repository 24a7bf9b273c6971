#include <gtest/gtest.h>

#include "shapes.h"

// Checks what the layers of a pyramid network refuse. Their results are checked by src/conform.
namespace raymeld::test {
namespace {

TEST(Pyramid, WrongShapesAreErrors) {
  const Shape low{2, 4, 3}, full{8, 16, 3};
  const char* name = "odd one";
  expect_only({full, full, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    light(graph, name, t[0], t[1], t[2], Transfer::kLog);
  });
  expect_only({full, full, low, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    light(graph, name, t[0], t[1], t[3], Transfer::kLog, Decimated{t[2], 4, 1});
  });
  expect_only({low, full, low}, [&](Graph& graph, const std::vector<Tensor>& t) {
    cell_light(graph, name, t[0], t[1], t[2], Transfer::kLog, 4, 1.5f);
  });
  expect_only({low, {2, 4, 1}, {2, 4, 9}}, [&](Graph& graph, const std::vector<Tensor>& t) {
    const Tensor image = graph.input("image", {4, 8, 12});
    pool(graph, name, image, t[2], Blend{.other = t[0], .shares = t[1]});
  });
  Graph graph(Storage::kFloat32);
  EXPECT_ERROR(pool(graph, name, graph.input("image", {4, 8, 8}), graph.tensor("out", {2, 4, 9})),
               "layer odd one", "4x8x8, expected 4x8x9");
  expect_only({full, {8, 16, 25}, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    kernel_filter(graph, name, t[0], t[1], t[2], 5);
  });
  expect_only({full, {8, 16, 10}, {4, 8, 3}, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    kernel_filter(graph, name, t[0], t[1], t[3], 3, {.coarse = t[2]});
  });
  expect_only({full, {8, 16, 11}, {8, 16, 6}, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    kernel_filter(graph, name, t[0], t[1], t[3], 3, {.guides = t[2]});
  });
  expect_only({{8, 16, 15}, full, {8, 16, 6}, low, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    compose(graph, name, t[0], t[1], t[2], t[3], t[4], Transfer::kLog, 4, 0);
  });
}

TEST(Pyramid, SidesAreOdd) {
  for (const uint32_t side : {2u, 4u}) {
    Graph graph(Storage::kFloat32);
    const Tensor image = graph.input("image", {8, 12, 3});
    EXPECT_ERROR(kernel_filter(graph, "odd one", image, graph.input("logits", {8, 12, side * side}),
                               graph.tensor("out", {8, 12, 3}), side),
                 "odd one", fmt::format("{} x {} pixels", side, side), "odd");
  }
}

TEST(Pyramid, SharesAreAtMostOne) {
  for (const float share : {-0.1f, 1.5f, NAN}) {
    Graph graph(Storage::kFloat32);
    const Tensor image = graph.input("image", {4, 4, 9}), other = graph.input("other", {2, 2, 3});
    EXPECT_ERROR(pool(graph, "odd one", image, graph.tensor("out", {2, 2, 9}), Blend{other, share}),
                 "odd one", "0 to 1");
  }
}

TEST(Pyramid, FramesAreNoLargerThanTheirTensors) {
  const EncodedChannel channels[] = {{.channel = 0}, {.channel = 1}, {.channel = 2}};
  for (const FrameSize frame : {FrameSize{0, 3}, {4, 0}, {5, 3}, {4, 4}}) {
    Graph graph(Storage::kFloat32);
    const Tensor image = graph.tensor("image", {4, 3, 3});
    const std::string size = fmt::format("{}x{}", frame.height, frame.width);
    EXPECT_ERROR(encode(graph, "odd one", kLrhsSlot, image, channels, Transfer::kLog, 1, frame), "odd one",
                 size, "at most 4x3");
    EXPECT_ERROR(variance(graph, "odd one", image, Transfer::kLog, 1, frame), "odd one", size);
    EXPECT_ERROR(decode(graph, "odd one", image, {.frame = frame}), "odd one", size);
  }
}

}  // namespace
}  // namespace raymeld::test
