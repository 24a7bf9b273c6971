// Adds the layers of a pyramid network.
#include <algorithm>

#include "layers/shapes.h"
#include "layers/upsampled.h"

namespace raymeld {

void light(Graph& graph, const std::string& name, const Tensor& color, const Tensor& albedo,
           const Tensor& out, Transfer transfer, const std::optional<Decimated>& decimated) {
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "the color", color, shape);
  expect_shape(name, "the albedo", albedo, shape);
  expect_shape(name, "the output", out, shape);
  const Tensor lrhs = decimated ? decimated->lrhs : color;
  const uint32_t scale = decimated ? decimated->scale : 0;
  if (decimated) {
    expect_shape(name, "LRHS", lrhs, with_channels(lrhs.shape, 3));
    expect_shape(name, "the output", out, enlarged(lrhs.shape, scale, 3));
  }
  Pass pass = pass_of(graph, name, shaders::kLight, {color, albedo, lrhs}, out);
  if (!decimated) pass.bytes -= traffic(graph, color);  // which is bound in the place of LRHS
  pass.constants = {scale};
  pass.set_push(params::Light{shape.height, shape.width, graph.plane(out), graph.plane(lrhs),
                              transfer == Transfer::kLog, decimated ? decimated->certainty : 0});
  pass.groups = strip_groups(with_channels(shape, 1));
  graph.add(std::move(pass));
}

void cell_light(Graph& graph, const std::string& name, const Tensor& lrhs, const Tensor& albedo,
                const Tensor& out, Transfer transfer, uint32_t scale, float phase) {
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "LRHS", lrhs, shape);
  expect_shape(name, "the albedo", albedo, enlarged(shape, scale, 3));
  expect_shape(name, "the output", out, shape);
  Pass pass = pass_of(graph, name, shaders::kCellLight, {lrhs, albedo}, out);
  pass.set_push(params::CellLight{shape.height, shape.width, graph.plane(out), graph.plane(albedo), scale,
                                  phase > 0 ? scale : 1, transfer == Transfer::kLog});
  pass.groups = pixel_groups(shape);
  graph.add(std::move(pass));
}

void pool(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
          const std::optional<Blend>& blend) {
  expect_shape(name, "the output", out, with_channels(out.shape, kPooledChannels));
  expect_shape(name, "the input", in, enlarged(out.shape, 2, std::max(in.shape.channels, kPooledChannels)));
  if (blend) {
    expect_shape(name, "the other image", blend->other, with_channels(out.shape, 3));
    if (!(blend->share >= 0 && blend->share <= 1))
      throw Error("layer {}: a share of {}, expected 0 to 1", name, blend->share);
  }
  // The input is bound in the place of what is not read.
  const Tensor other = blend ? blend->other : in;
  const Tensor shares = blend && blend->shares ? *blend->shares : other;
  if (blend && blend->shares) expect_shape(name, "the shares", shares, with_channels(out.shape, 1));
  Pass pass = pass_of(graph, name, shaders::kPool, {in, other, shares}, out);
  pass.bytes = traffic(graph, in.slice(0, kPooledChannels)) + traffic(graph, out);
  if (blend) pass.bytes += traffic(graph, other);
  if (blend && blend->shares) pass.bytes += traffic(graph, shares);
  pass.constants = {blend && blend->shares};
  pass.set_push(params::Pool{out.shape.height, out.shape.width, graph.plane(out), graph.plane(in),
                             in.shape.channels - kPooledChannels, blend ? blend->share : 0});
  pass.groups = element_groups(out.shape);
  graph.add(std::move(pass));
}

void kernel_filter(Graph& graph, const std::string& name, const Tensor& in, const Tensor& logits,
                   const Tensor& out, uint32_t side, const KernelInputs& inputs) {
  const auto& [coarse, guides] = inputs;
  if (side % 2 == 0)
    throw Error("layer {}: a kernel of {} x {} pixels, expected an odd side", name, side, side);
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "the output", out, shape);
  expect_shape(name, "the input", in, shape);
  expect_shape(name, "the logits", logits,
               with_channels(shape, side * side + (coarse ? 1 : 0) + (guides ? 2 : 0)));
  if (coarse) {
    expect_shape(name, "the coarse image", *coarse, with_channels(coarse->shape, 3));
    expect_shape(name, "the input", in, enlarged(coarse->shape, 2, 3));
  }
  if (guides) expect_shape(name, "the guides", *guides, with_channels(shape, 6));
  const Tensor smaller = coarse.value_or(in), surfaces = guides.value_or(in);
  Pass pass = pass_of(graph, name, shaders::kKernelFilter, {in, logits, smaller, surfaces}, out);
  pass.constants = {side, coarse.has_value(), guides.has_value()};
  pass.set_push(params::KernelFilter{shape.height, shape.width, graph.plane(out), smaller.shape.height,
                                     smaller.shape.width, graph.plane(smaller)});
  pass.groups = pixel_groups(shape);
  pass.flop = (guides ? 50.0 : 10.0) * side * side * static_cast<double>(shape.pixels());
  graph.add(std::move(pass));
}

void compose(Graph& graph, const std::string& name, const Tensor& rec, const Tensor& light,
             const Tensor& guides, const Tensor& lrhs, const Tensor& out, Transfer transfer, uint32_t scale,
             float phase) {
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "the network's output", rec, with_channels(shape, 15));
  expect_shape(name, "the light", light, shape);
  expect_shape(name, "the guides", guides, with_channels(shape, 6));
  expect_shape(name, "LRHS", lrhs, with_channels(lrhs.shape, 3));
  expect_shape(name, "the output", out, enlarged(lrhs.shape, scale, 3));
  Pass pass = pass_of(graph, name, shaders::kCompose, {rec, light, guides, lrhs}, out);
  pass.set_push(upsampled(graph, out, lrhs, transfer, scale, phase));
  pass.groups = pixel_groups(shape);
  graph.add(std::move(pass));
}

}  // namespace raymeld
