// 1x1 convolutions of what is unshuffled, which read the cells of the image where they lie.
#include <numeric>

#include "layers/conv2d.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kMostOutputs = 6;     // output channels of an invocation, each with a sum for every column
constexpr uint32_t kLocalCells = 64;     // cells of a workgroup of pointwise_cells.comp
constexpr uint32_t kVectorsPixels = 64;  // of a row, and a workgroup of pointwise_cells_vectors.comp

struct Cells {
  uint32_t side, channels;   // of the image
  uint32_t outputs, blocks;  // blocks of so many output channels, the last one padded
  uint32_t weight_columns;   // a multiple of side
};

// The layout of both shaders: [block][channel][row][output][column], the columns again and again, zeros where
// channels end early.
void pack_weights(std::byte* target, const Convolution& conv, const Cells& cells) {
  auto* next = reinterpret_cast<float*>(target);
  for (uint32_t block = 0; block < cells.blocks; ++block) {
    for (uint32_t row = 0; row < cells.channels * cells.side; ++row) {
      for (uint32_t o = block * cells.outputs; o < (block + 1) * cells.outputs; ++o) {
        for (uint32_t x = 0; x < cells.weight_columns; ++x)
          *next++ = o < conv.channels_out ? conv.weight_at(o, row * cells.side + x % cells.side, 0, 0) : 0.0f;
      }
    }
  }
}

// Graph::vector(), or 0 where pointwise_cells_vectors.comp does not know such cells. The same for all sizes
// of a frame, as the weights' layout follows it.
uint32_t vector_of_cells(const Graph& graph, uint32_t side) {
  const uint32_t vector = graph.vector();
  const bool possible =
      vector > 0 && RAYMELD_LANES % vector == 0 && vector % side == 0 && graph.storage() == Storage::kFloat32;
  return possible ? vector : 0;
}

// Whether that shader can number the vectors and the rows of cells.
bool has_numbers(const Convolution& conv, uint32_t vector) {
  static_assert(kVectorsPixels * sizeof(float) <= Graph::kGuardBytes);
  return conv.height <= kUniformNumbers && divide_up(conv.in.shape.width, 2 * vector) <= kUniformNumbers;
}

}  // namespace

void conv2d_cells(Graph& graph, const Convolution& conv) {
  if (conv.options.shuffle > 1 || !conv.options.residuals.empty())
    throw Error("layer {}: a 1x1 that is unshuffled has no shuffle and no residuals", conv.name);
  const uint32_t side = conv.options.unshuffle, vector = vector_of_cells(graph, side);
  const bool by_vectors = vector > 0 && has_numbers(conv, vector);
  const uint32_t blocks = divide_up(conv.channels_out, kMostOutputs);
  const Cells cells{.side = side,
                    .channels = conv.in.shape.channels,
                    .outputs = divide_up(conv.channels_out, blocks),
                    .blocks = blocks,
                    .weight_columns = vector > 0 ? vector : side};
  const uint64_t weight_bytes =
      uint64_t{blocks} * cells.outputs * cells.channels * side * cells.weight_columns * sizeof(float);
  const uint32_t weights = graph.constant(conv.name + ".weight", weight_bytes,
                                          [=](std::byte* target) { pack_weights(target, conv, cells); });
  const bool by_address = graph.addressed() || by_vectors;
  Pass pass;
  pass.name = conv.name;
  pass.shader = by_vectors ? &shaders::kPointwiseCellsVectors : &shaders::kPointwiseCells[by_address];
  pass.constants = {side, cells.channels, cells.outputs, conv.options.relu, cells.weight_columns};
  pass.bindings = {constant_binding(weights),
                   constant_binding(bias_constant(graph, conv, blocks * cells.outputs)),
                   read_binding(conv.in), write_binding(conv.out)};
  for (Binding& binding : pass.bindings)
    binding.by_address = by_address || binding.kind == Binding::Kind::kConstant;
  params::PointwiseCells push{graph.plane(conv.in), conv.in.shape.width, graph.plane(conv.out),
                              conv.height,          conv.channels_out,   {}};
  std::iota(std::begin(push.digits), std::end(push.digits), 0u);
  pass.set_push(push);
  if (by_vectors) {
    pass.groups = {divide_up(conv.in.shape.width, kVectorsPixels), blocks, conv.height};
  } else {
    pass.groups = {divide_up(conv.width, kLocalCells), conv.height, blocks};
  }
  pass.flop = conv.flop();
  pass.bytes = tensor_bytes(graph, conv) + static_cast<double>(weight_bytes);
  graph.add(std::move(pass));
}

}  // namespace raymeld
