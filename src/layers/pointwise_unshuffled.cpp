// Adds 1x1 convolutions of unshuffled pixels, which read the image where it lies. An unshuffled pixel is
// side x side pixels of the image.

#include "layers/conv2d.h"
#include "layers/llvmpipe.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kMostOutputs = 6;  // output channels of an invocation, each with a sum for every column
constexpr uint32_t kUnshuffledLocal = 64;  // unshuffled pixels of a workgroup of pointwise_unshuffled.comp

struct Layout {
  uint32_t side, channels;   // the side of an unshuffled pixel, the image's channels
  uint32_t outputs, blocks;  // blocks of so many output channels, the last one padded
  uint32_t weight_columns;   // a multiple of side
};

// Writes weights in the layout of both shaders, [block][channel][row][output][column], in which the columns
// repeat, with zeros where channels end early.
void pack_weights(std::byte* target, const Convolution& conv, const Layout& layout) {
  auto* next = reinterpret_cast<float*>(target);
  for (uint32_t block = 0; block < layout.blocks; ++block) {
    for (uint32_t row = 0; row < layout.channels * layout.side; ++row) {
      for (uint32_t o = block * layout.outputs; o < (block + 1) * layout.outputs; ++o) {
        for (uint32_t x = 0; x < layout.weight_columns; ++x)
          *next++ =
              o < conv.channels_out ? conv.weight_at(o, row * layout.side + x % layout.side, 0, 0) : 0.0f;
      }
    }
  }
}

}  // namespace

void conv2d_pointwise_unshuffled(Graph& graph, const Convolution& conv) {
  if (conv.options.shuffle > 1 || !conv.options.residuals.empty())
    throw Error("layer {}: an unshuffled 1x1 cannot shuffle its output or add residuals", conv.name);
  const uint32_t side = conv.options.unshuffle, vector = llvmpipe::unshuffled_vector(graph, side);
  const bool by_vectors = vector > 0 && llvmpipe::numbers_unshuffled(conv, vector);
  const uint32_t blocks = divide_up(conv.channels_out, kMostOutputs);
  const Layout layout{.side = side,
                      .channels = conv.in.shape.channels,
                      .outputs = divide_up(conv.channels_out, blocks),
                      .blocks = blocks,
                      .weight_columns = vector > 0 ? vector : side};
  const uint64_t weight_bytes =
      uint64_t{blocks} * layout.outputs * layout.channels * side * layout.weight_columns * sizeof(float);
  const uint32_t weights = graph.constant(conv.name + ".weight", weight_bytes,
                                          [=](std::byte* target) { pack_weights(target, conv, layout); });
  Pass pass = pass_of(graph, conv.name, shaders::kPointwiseUnshuffled,
                      {constant_binding(weights, true),
                       constant_binding(bias_constant(graph, conv, blocks * layout.outputs), true),
                       read_binding(conv.in), write_binding(conv.out)},
                      by_vectors);
  pass.constants = {side, layout.channels, layout.outputs, conv.options.relu, layout.weight_columns};
  set_push(pass,
           params::PointwiseUnshuffled{graph.plane(conv.in), conv.in.shape.width, graph.plane(conv.out),
                                       conv.height, conv.channels_out},
           by_vectors);
  if (by_vectors) {
    pass.groups = {divide_up(conv.in.shape.width, llvmpipe::kUnshuffledPixels), blocks, conv.height};
  } else {
    pass.groups = {divide_up(conv.width, kUnshuffledLocal), conv.height, blocks};
  }
  pass.flop = conv.flop();
  pass.bytes = tensor_bytes(graph, conv) + static_cast<double>(weight_bytes);
  graph.add(std::move(pass));
}

}  // namespace raymeld
