#include <gtest/gtest.h>

#include "shapes.h"

// Checks what the layers of RCAN and KPCN refuse. Their results are checked by src/conform.
namespace raymeld::test {
namespace {

TEST(RcanAndKpcn, WrongShapesAreErrors) {
  const Shape image{8, 16, 5}, one{1, 1, 5}, color{8, 16, 3};
  const char* name = "odd one";
  expect_only({image, one, image, image}, [&](Graph& graph, const std::vector<Tensor>& t) {
    attend(graph, name, t[0], t[1], t[2], t[3]);
  });
  expect_only({image, {8, 16, 10}},
              [&](Graph& graph, const std::vector<Tensor>& t) { gradients(graph, name, t[0], t[1]); });
  expect_only({color, color, color}, [&](Graph& graph, const std::vector<Tensor>& t) {
    remainder(graph, name, t[0], t[1], t[2], Transfer::kLog);
  });
  expect_only({color, color, color, color}, [&](Graph& graph, const std::vector<Tensor>& t) {
    remodulate(graph, name, t[0], t[1], t[2], t[3], Transfer::kLog);
  });
}

TEST(RcanAndKpcn, AttentionKeepsExponents) {
  Graph graph(Storage::kFloat16);
  const Tensor in = graph.tensor("in", {8, 16, 5}, 3), out = graph.tensor("out", {8, 16, 5}, 3);
  const Tensor plain = graph.tensor("plain", {8, 16, 5});
  const Tensor logits = graph.tensor("logits", {1, 1, 5}), scaled = graph.tensor("scaled", {1, 1, 5}, 3);
  EXPECT_ERROR(channel_means(graph, "odd one", in, logits), "odd one", "the output",
               "exponent 0, expected 3");
  EXPECT_ERROR(attend(graph, "odd one", plain, logits, in, out), "odd one", "the input", "expected 3");
  EXPECT_ERROR(attend(graph, "odd one", in, scaled, in, out), "odd one", "the logits", "expected 0");
  EXPECT_ERROR(attend(graph, "odd one", in, logits, plain, out), "odd one", "the residual", "expected 3");
}

// The input may have any size.
TEST(RcanAndKpcn, MeansAreOnePixelOfAsManyChannels) {
  for (const Shape shape : {Shape{1, 1, 4}, {1, 1, 6}, {2, 1, 5}, {1, 2, 5}}) {
    Graph graph(Storage::kFloat32);
    const Tensor in = graph.input("in", {8, 16, 5}), out = graph.tensor("out", shape);
    EXPECT_ERROR(channel_means(graph, "odd one", in, out), "odd one", "expected 1x1x5");
  }
}

}  // namespace
}  // namespace raymeld::test
