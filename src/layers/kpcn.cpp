// Adds the layers of KPCN that are its own.
#include "layers/shapes.h"

namespace raymeld {

void gradients(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out) {
  const Shape& shape = in.shape;
  expect_shape(name, "the output", out, with_channels(shape, 2 * shape.channels));
  Pass pass = pass_of(graph, name, shaders::kGradients, {in}, out);
  pass.set_push(params::Gradients{shape.height, shape.width, graph.plane(in), shape.channels});
  pass.groups = element_groups(shape);
  graph.add(std::move(pass));
}

void remainder(Graph& graph, const std::string& name, const Tensor& whole, const Tensor& part,
               const Tensor& out, Transfer transfer) {
  const Shape& shape = out.shape;
  expect_shape(name, "the radiance", whole, shape);
  expect_shape(name, "the part", part, shape);
  Pass pass = pass_of(graph, name, shaders::kRemainder, {whole, part}, out);
  pass.set_push(params::Remainder{shape.height, shape.width, graph.plane(out), transfer == Transfer::kLog});
  pass.groups = element_groups(shape);
  graph.add(std::move(pass));
}

void remodulate(Graph& graph, const std::string& name, const Tensor& demodulated, const Tensor& albedo,
                const Tensor& rest, const Tensor& out, Transfer transfer) {
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "the demodulated radiance", demodulated, shape);
  expect_shape(name, "the albedo", albedo, shape);
  expect_shape(name, "the rest", rest, shape);
  expect_shape(name, "the output", out, shape);
  Pass pass = pass_of(graph, name, shaders::kRemodulate, {demodulated, albedo, rest}, out);
  pass.set_push(params::Remodulate{shape.height, shape.width, graph.plane(out), transfer == Transfer::kLog});
  pass.groups = strip_groups(shape);
  graph.add(std::move(pass));
}

}  // namespace raymeld
