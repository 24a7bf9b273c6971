// Adds the layers that prepare the inputs of KPCN.
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

}  // namespace raymeld
