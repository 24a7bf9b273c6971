// Convolutions by minimal filtering: transform the input, multiply, transform back, one band of tile rows after another.
#include <algorithm>

#include "layers/conv2d.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kLanes = 16;            // winograd.glsl
constexpr uint32_t kMultiplyLocal = 64;    // tiles of a workgroup of winograd_multiply.comp
constexpr uint32_t kTransformLocal = 64;   // and of the transforms
constexpr uint32_t kPaddingElements = 16;  // keeps positions from falling into the same set of a cache

// One of G, by tile; Lavin and Gray 2016, section 4.
using Filter = std::array<std::array<double, 3>, 6>;
constexpr Filter kFilter2{{{1, 0, 0}, {0.5, 0.5, 0.5}, {0.5, -0.5, 0.5}, {0, 0, 1}}};
constexpr Filter kFilter4{{{1. / 4, 0, 0},
                           {-1. / 6, -1. / 6, -1. / 6},
                           {-1. / 6, 1. / 6, -1. / 6},
                           {1. / 24, 1. / 12, 1. / 6},
                           {1. / 24, -1. / 12, 1. / 6},
                           {0, 0, 1}}};

struct Sizes {
  uint32_t tile, side, positions;
  uint32_t tiles_x, tile_rows, band_rows, band_tiles;  // tiles_x even; band_tiles a multiple of all workgroups
  uint32_t channels;                                   // of one chunk
  uint32_t chunks, channels_padded;
  uint32_t outputs, blocks;
  uint32_t transformed_stride, products_stride;
};

Sizes sizes_of(const Convolution& conv) {
  const Conv2dKernel& how = conv.options.how;
  Sizes s;
  s.tile = how.tile;
  s.side = how.tile + conv.options.kernel - 1;
  s.positions = s.side * s.side;
  s.tiles_x = divide_up(conv.width, 2 * s.tile) * 2;
  s.tile_rows = divide_up(conv.height, s.tile);
  s.band_rows = std::clamp(how.band / s.tiles_x, 1u, s.tile_rows);
  s.band_tiles = divide_up(s.band_rows * s.tiles_x, kMultiplyLocal) * kMultiplyLocal;
  s.chunks = divide_up(conv.channels_in, how.channels);
  s.channels = divide_up(conv.channels_in, s.chunks);
  s.channels_padded = s.chunks * s.channels;
  s.blocks = divide_up(conv.channels_out, how.outputs);
  s.outputs = divide_up(conv.channels_out, s.blocks);
  s.transformed_stride = s.band_tiles * s.channels_padded + kPaddingElements;
  s.products_stride = s.band_tiles * s.blocks * s.outputs + kPaddingElements;
  return s;
}

// G g G^T.
double transformed_weight(const Convolution& conv, uint32_t o, uint32_t i, uint32_t row, uint32_t column) {
  const Filter& g = conv.options.how.tile == 4 ? kFilter4 : kFilter2;
  double sum = 0;
  for (uint32_t ky = 0; ky < conv.options.kernel; ++ky) {
    for (uint32_t kx = 0; kx < conv.options.kernel; ++kx)
      sum += g[row][ky] * conv.weight_at(o, i, ky, kx) * g[column][kx];
  }
  return sum;
}

// The layout of winograd_multiply.comp: [position][block][in][output], zeros where channels end early.
void pack_weights(std::byte* target, const Convolution& conv, const Sizes& s) {
  auto* next = reinterpret_cast<float*>(target);
  for (uint32_t position = 0; position < s.positions; ++position) {
    for (uint32_t block = 0; block < s.blocks; ++block) {
      for (uint32_t i = 0; i < s.channels_padded; ++i) {
        for (uint32_t output = 0; output < s.outputs; ++output) {
          const uint32_t o = block * s.outputs + output;
          const bool inside = o < conv.channels_out && i < conv.channels_in;
          *next++ = inside ? float(transformed_weight(conv, o, i, position / s.side, position % s.side)) : 0.0f;
        }
      }
    }
  }
}


struct Steps {
  Graph& graph;
  const Convolution& conv;
  const Sizes s = sizes_of(conv);
  const bool addressed = conv.options.how.addressed;
  const Tensor transformed = graph.scratch(conv.name + ".transformed", uint64_t{s.transformed_stride} * s.positions);
  const Tensor products = graph.scratch(conv.name + ".products", uint64_t{s.products_stride} * s.positions);
  const uint64_t weight_count = uint64_t{s.positions} * s.blocks * s.channels_padded * s.outputs;
  const uint32_t weights = graph.constant(conv.name + ".weight", weight_count * sizeof(float),
                                          [c = conv, s = s](std::byte* target) { pack_weights(target, c, s); });
  const uint32_t bias = bias_constant(graph, conv, s.blocks * s.outputs);

  Pass pass(const shaders::Forms& forms, std::vector<Binding> bindings) const {
    Pass result;
    result.name = conv.name;
    result.shader = &forms[addressed];
    result.bindings = std::move(bindings);
    for (Binding& binding : result.bindings) binding.by_address |= addressed;
    return result;
  }

  // Share of the whole convolution that a band is.
  double share() const { return double(s.band_rows) / s.tile_rows; }

  void input(uint32_t first_tile_row) const {
    Pass p = pass(shaders::kWinogradInput, {read_binding(conv.in), write_binding(transformed)});
    p.constants = {s.tile, conv.options.unshuffle};
    p.set_push(params::WinogradInput{conv.height, conv.width, plane_of(graph, conv.in), s.tiles_x, first_tile_row,
                                     conv.channels_in, s.channels_padded, s.transformed_stride});
    p.groups = {s.band_tiles / kTransformLocal, 1, s.channels_padded};
    p.bytes = share() * traffic(graph, conv.in);
    graph.add(std::move(p));
  }

  void multiply(uint32_t chunk) const {
    Binding weight = constant_binding(weights);
    weight.by_address = true;
    Pass p = pass(shaders::kWinogradMultiply, {weight, read_binding(transformed), write_binding(products)});
    p.constants = {s.tile, s.channels, s.outputs, chunk > 0, conv.options.how.order};
    params::WinogradMultiply push{s.channels_padded, chunk * s.channels,  s.blocks,
                                  s.transformed_stride, s.products_stride, {}};
    for (uint32_t i = 0; i < std::size(push.digits); ++i) push.digits[i] = i;
    p.set_push(push);
    p.groups = {s.band_tiles / kMultiplyLocal, s.blocks, s.positions};
    p.flop = share() * conv.flop() / s.chunks;
    p.bytes = share() * double(weight_count) * sizeof(float) / s.chunks;
    graph.add(std::move(p));
  }

  void output(uint32_t first_tile_row) const {
    std::vector<Binding> bindings{read_binding(products), constant_binding(bias), write_binding(conv.out)};
    for (uint32_t i = 0; i < kMostResiduals; ++i) bindings.push_back(residual_binding(conv, i, products));
    Pass p = pass(shaders::kWinogradOutput, std::move(bindings));
    p.constants = {s.tile, conv.options.shuffle, conv.options.relu,
                   static_cast<uint32_t>(conv.options.residuals.size())};
    p.set_push(params::WinogradOutput{conv.height, conv.width, plane_of(graph, conv.out), s.tiles_x, first_tile_row,
                                      s.blocks * s.outputs, s.products_stride});
    p.groups = {s.band_tiles / kTransformLocal, 1, conv.channels_out};
    p.bytes = share() * traffic(graph, conv.out) * (1.0 + double(conv.options.residuals.size()));
    graph.add(std::move(p));
  }
};

}  // namespace

void conv2d_winograd(Graph& graph, const Convolution& conv) {
  const Steps steps{.graph = graph, .conv = conv};
  if (steps.s.blocks > 63) throw Error("layer {}: more than 63 blocks of output channels", conv.name);
  for (uint32_t row = 0; row < steps.s.tile_rows; row += steps.s.band_rows) {
    steps.input(row);
    for (uint32_t chunk = 0; chunk < steps.s.chunks; ++chunk) steps.multiply(chunk);
    steps.output(row);
  }
}

}  // namespace raymeld
