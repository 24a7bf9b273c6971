// Adds the layers of channel attention.
#include "layers/shapes.h"

namespace raymeld {
namespace {

void expect_exponent(const Graph& graph, const std::string& name, const char* what, const Tensor& tensor,
                     int exponent) {
  if (graph.exponent(tensor) == exponent) return;
  throw Error("layer {}: {} has the exponent {}, expected {}", name, what, graph.exponent(tensor), exponent);
}

}  // namespace

void channel_means(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out) {
  const Shape& shape = in.shape;
  expect_shape(name, "the output", out, {1, 1, shape.channels});
  expect_exponent(graph, name, "the output", out, graph.exponent(in));
  if (shape.pixels() >= 1u << 31)
    throw Error("layer {}: {} pixels, expected fewer than 2^31", name, shape.pixels());
  Pass pass = pass_of(graph, name, shaders::kChannelMeans, {in}, out);
  pass.set_push(params::ChannelMeans{uint32_t(shape.pixels()), graph.plane(in), graph.plane(out)});
  pass.groups = {1, 1, shape.channels};
  graph.add(std::move(pass));
}

void attend(Graph& graph, const std::string& name, const Tensor& in, const Tensor& logits,
            const Tensor& residual, const Tensor& out) {
  const Shape& shape = out.shape;
  expect_shape(name, "the input", in, shape);
  expect_shape(name, "the logits", logits, {1, 1, shape.channels});
  expect_shape(name, "the residual", residual, shape);
  expect_exponent(graph, name, "the input", in, graph.exponent(out));
  expect_exponent(graph, name, "the logits", logits, 0);
  expect_exponent(graph, name, "the residual", residual, graph.exponent(out));
  Pass pass = pass_of(graph, name, shaders::kAttend, {in, logits, residual}, out);
  pass.set_push(params::Attend{shape.height, shape.width, graph.plane(out), graph.plane(logits)});
  pass.groups = strip_groups(shape);
  graph.add(std::move(pass));
}

}  // namespace raymeld
