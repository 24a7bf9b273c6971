// What a sparse graph computes, and what it does not.
#include "layers/upsampled.h"

namespace raymeld {
namespace {

Pass pass_of(const Graph& graph, const std::string& name, const shaders::Forms& shader,
             std::vector<Binding> bindings) {
  if (!graph.sparse()) throw Error("layer {}: the graph is not sparse", name);
  Pass pass;
  pass.name = name;
  pass.shader = &shader[graph.addressed()];
  pass.bindings = std::move(bindings);
  for (Binding& binding : pass.bindings) {
    binding.by_address = graph.addressed();
    pass.bytes += traffic(graph, binding.tensor);
  }
  return pass;
}

params::Upsampled push_of(const Graph& graph, const std::string& name, const Tensor& color,
                          const Tensor& lrhs, float phase) {
  const uint32_t scale = graph.scale_of(color.shape);
  if (color.shape.channels != 3 || lrhs.shape.channels != 3 ||
      lrhs.shape.width * scale != color.shape.width || lrhs.shape.height * scale != color.shape.height) {
    throw Error("layer {}: LRHS of {}x{}x{} does not fit HRLS of {}x{}x{}", name, lrhs.shape.height,
                lrhs.shape.width, lrhs.shape.channels, color.shape.height, color.shape.width,
                color.shape.channels);
  }
  return upsampled(graph, color, lrhs, Transfer::kLinear, scale, phase);
}

}  // namespace

void classify(Graph& graph, const std::string& name, const Tensor& color, const Tensor& lrhs, float phase) {
  Pass pass = pass_of(graph, name, shaders::kClassify, {read_binding(color), read_binding(lrhs)});
  pass.constants = {graph.sparse()->by_host};
  pass.set_push(push_of(graph, name, color, lrhs, phase));
  pass.groups = {graph.sparse()->columns(), graph.sparse()->rows(), 1};
  graph.add(std::move(pass));
}

void schedule(Graph& graph, const std::string& name) {
  Pass pass;
  pass.name = name;
  pass.shader = &shaders::kSchedule;
  pass.schedules = true;
  graph.add(std::move(pass));
}

void settle(Graph& graph, const std::string& name, const Tensor& color, const Tensor& lrhs, float phase,
            bool residual, const Tensor& out) {
  if (out.shape != color.shape) throw Error("layer {}: the output's shape is not that of HRLS", name);
  Pass pass =
      pass_of(graph, name, shaders::kSettle, {read_binding(color), read_binding(lrhs), write_binding(out)});
  pass.constants = {residual};
  pass.set_push(push_of(graph, name, color, lrhs, phase));
  pass.groups = pixel_groups(out.shape);
  graph.add(std::move(pass));
}

}  // namespace raymeld
