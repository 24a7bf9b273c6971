// Checks shapes and makes passes for layers whose inputs are tensors that are each read once.
#pragma once

#include <initializer_list>

#include "layers/layers.h"
#include "layers/shaders.h"

namespace raymeld {

inline void expect_shape(const std::string& name, const char* what, const Tensor& tensor,
                         const Shape& expected) {
  const Shape& shape = tensor.shape;
  if (shape == expected) return;
  throw Error("layer {}: {} is {}x{}x{}, expected {}x{}x{}", name, what, shape.height, shape.width,
              shape.channels, expected.height, expected.width, expected.channels);
}

inline Shape with_channels(Shape shape, uint32_t channels) {
  shape.channels = channels;
  return shape;
}

inline Shape enlarged(const Shape& shape, uint32_t scale, uint32_t channels) {
  return {scale * shape.height, scale * shape.width, channels};
}

// Returns the size of a frame's image, by default that of the tensor. Throws Error.
inline FrameSize frame_size(const std::string& name, const Tensor& tensor,
                            const std::optional<FrameSize>& frame) {
  const auto [height, width, channels] = tensor.shape;
  if (!frame) return {height, width};
  if (frame->height == 0 || frame->width == 0 || frame->height > height || frame->width > width)
    throw Error("layer {}: an image of {}x{}, expected at most {}x{}", name, frame->height, frame->width,
                height, width);
  return *frame;
}

// Returns a pass that reads the inputs once and writes the output.
inline Pass pass_of(const Graph& graph, const std::string& name, const Forms& forms,
                    std::initializer_list<Tensor> inputs, const Tensor& out, bool vectors = false) {
  std::vector<Binding> bindings;
  double bytes = traffic(graph, out);
  for (const Tensor& input : inputs) {
    bindings.push_back(read_binding(input));
    bytes += traffic(graph, input);
  }
  bindings.push_back(write_binding(out));
  Pass pass = pass_of(graph, name, forms, std::move(bindings), vectors);
  pass.bytes = bytes;
  return pass;
}

}  // namespace raymeld
