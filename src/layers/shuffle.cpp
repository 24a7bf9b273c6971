#include "layers/layers.h"
#include "layers/shaders.h"
#include "params.h"

namespace raymeld {
namespace {

// Returns r, where `small` is (h, w, r r c) and `large` is (r h, r w, c).
uint32_t factor_of(const std::string& name, const Shape& small, const Shape& large) {
  const uint32_t factor = large.height / small.height;
  if (large.height != factor * small.height || large.width != factor * small.width ||
      small.channels != factor * factor * large.channels) {
    throw Error("layer {}: {}x{}x{} and {}x{}x{} are not a shuffle of each other", name, small.height,
                small.width, small.channels, large.height, large.width, large.channels);
  }
  return factor;
}

Pass shuffle(const Graph& graph, const std::string& name, const Shader& shader, const Tensor& in,
             const Tensor& out, const Tensor& small_image, const Tensor& large_image) {
  const Shape &small = small_image.shape, &large = large_image.shape;
  if (graph.exponent(in) != graph.exponent(out))
    throw Error("layer {}: the exponents of input and output differ", name);
  Pass pass;
  pass.name = name;
  pass.shader = &shader;
  pass.constants = {factor_of(name, small, large)};
  pass.bindings = {read_binding(in), write_binding(out)};
  pass.set_push(
      params::Shuffle{small.height, small.width, graph.plane(small_image), graph.plane(large_image)});
  pass.groups = element_groups(out.shape);
  pass.bytes = 2.0 * static_cast<double>(large.pixels() * large.channels * element_bytes(graph.storage()));
  return pass;
}

}  // namespace

void space_to_depth(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out) {
  graph.add(shuffle(graph, name, shaders::kSpaceToDepth, in, out, out, in));
}

void pixel_shuffle(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out) {
  graph.add(shuffle(graph, name, shaders::kPixelShuffle, in, out, in, out));
}

}  // namespace raymeld
