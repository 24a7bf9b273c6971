// Adds the layers that join a frame with the ones before it.
#include <algorithm>

#include "layers/shapes.h"

namespace raymeld {
namespace {

// Returns a pass that reads motion and the last history, and writes to the next one. It has the form of the
// shader for motion in a buffer or in an image.
Pass pass_with_history(const Graph& graph, const std::string& name, const Forms& buffer, const Forms& image,
                       std::initializer_list<Tensor> inputs, const Tensor& out) {
  const auto history = [](FrameSlot slot, Access access) {
    return Binding{.kind = Binding::Kind::kFrame, .access = access, .slot = slot};
  };
  std::vector<Binding> bindings{frame_binding(graph, kMotionSlot), history(kLastSlot, Access::kRead),
                                history(kNextSlot, Access::kWrite), exposure_binding()};
  for (const Tensor& tensor : inputs) bindings.push_back(read_binding(tensor));
  bindings.push_back(write_binding(out));
  return pass_of(graph, name, graph.frame_images().inputs ? image : buffer, std::move(bindings));
}

}  // namespace

void light_change(Graph& graph, const std::string& name, const Tensor& lrhs, const Tensor& out,
                  Transfer transfer, uint32_t scale, uint32_t channels,
                  const std::optional<FrameSize>& frame) {
  const Shape shape = with_channels(out.shape, 2);
  expect_shape(name, "LRHS", lrhs, with_channels(shape, 3));
  expect_shape(name, "the output", out, shape);
  Pass pass = pass_with_history(graph, name, shaders::kLightChange, shaders::kLightChangeImage, {lrhs}, out);
  const auto [height, width] = frame_size(name, out, frame);
  pass.set_push(params::LightChange{{},
                                    shape.height,
                                    shape.width,
                                    height,
                                    width,
                                    graph.plane(lrhs),
                                    scale,
                                    history_planes(channels),
                                    transfer == Transfer::kLog,
                                    1 / static_cast<float>(scale * scale * scale)});
  pass.groups = pixel_groups(shape);
  pass.bytes = traffic(graph, lrhs) + traffic(graph, out) +
               static_cast<double>(shape.pixels() * (8 * scale * scale + 40));
  graph.add(std::move(pass));
}

void accumulate(Graph& graph, const std::string& name, const Tensor& hrls, const Tensor& out,
                const AccumulateOptions& options) {
  const Shape shape = hrls.shape;
  const auto [change, scale] = std::pair(options.change, options.scale);
  expect_shape(name, "the output", out, with_channels(shape, out.shape.channels));
  const uint32_t most = std::min(shape.channels, out.shape.channels - 1);
  if (options.channels < 9 || options.channels > most)
    throw Error("layer {}: {} channels to accumulate, expected 9 to {}", name, options.channels, most);
  if (change) expect_shape(name, "HRLS", hrls, enlarged(change->shape, scale, shape.channels));
  if (change) expect_shape(name, "the change of the light", *change, with_channels(change->shape, 2));
  Pass pass = pass_with_history(graph, name, shaders::kAccumulate, shaders::kAccumulateImage,
                                {hrls, change.value_or(hrls)}, out);
  const auto [height, width] = frame_size(name, hrls, options.frame);
  pass.set_push(params::Accumulate{{},
                                   shape.height,
                                   shape.width,
                                   height,
                                   width,
                                   graph.plane(hrls),
                                   options.channels,
                                   out.shape.channels - 1,
                                   options.has_depth,
                                   change ? change->shape.height : 0,
                                   change ? change->shape.width : 0,
                                   change ? graph.plane(*change) : 0,
                                   change ? 1 / static_cast<float>(scale) : 0,
                                   options.transfer == Transfer::kLog,
                                   options.clip,
                                   options.spp});
  pass.groups = pixel_groups(shape);
  pass.bytes =
      traffic(graph, hrls) + traffic(graph, out) +
      static_cast<double>(shape.pixels() * (8 * (options.channels + 4) + (options.has_depth ? 16 : 8)));
  graph.add(std::move(pass));
}

void settle(Graph& graph, const std::string& name, const Tensor& fused, const Tensor& samples,
            const Tensor& out, const SettleOptions& options) {
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "the fused image", fused, shape);
  expect_shape(name, "the samples", samples, with_channels(shape, 1));
  expect_shape(name, "the output", out, shape);
  Pass pass = pass_with_history(graph, name, shaders::kSettle, shaders::kSettleImage, {fused, samples}, out);
  const auto [height, width] = frame_size(name, out, options.frame);
  pass.set_push(params::Settle{{},
                               shape.height,
                               shape.width,
                               height,
                               width,
                               graph.plane(out),
                               history_planes(options.channels) - 3,
                               options.transfer == Transfer::kLog,
                               options.clip,
                               options.spp});
  pass.groups = pixel_groups(shape);
  pass.bytes =
      traffic(graph, fused) + traffic(graph, out) + static_cast<double>(shape.pixels() * (8 * 3 + 8));
  graph.add(std::move(pass));
}

void color_variance(Graph& graph, const std::string& name, const Tensor& color, const Tensor& out,
                    Transfer transfer, float clip, const std::optional<FrameSize>& frame) {
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "the color", color, shape);
  expect_shape(name, "the output", out, shape);
  Pass pass = pass_of(graph, name, shaders::kColorVariance, {color}, out);
  const auto [height, width] = frame_size(name, out, frame);
  pass.set_push(params::ColorVariance{shape.height, shape.width, height, width, graph.plane(out),
                                      transfer == Transfer::kLog, clip});
  pass.groups = pixel_groups(shape);
  graph.add(std::move(pass));
}

void cell_share(Graph& graph, const std::string& name, const Tensor& samples, const Tensor& out,
                uint32_t scale, float certainty) {
  const Shape shape = with_channels(out.shape, 1);
  expect_shape(name, "the samples", samples, enlarged(shape, scale, 1));
  expect_shape(name, "the output", out, shape);
  Pass pass = pass_of(graph, name, shaders::kCellShare, {samples}, out);
  pass.set_push(params::CellShare{shape.height, shape.width, graph.plane(samples), scale, certainty});
  pass.groups = pixel_groups(shape);
  graph.add(std::move(pass));
}

}  // namespace raymeld
