// Adds Winograd convolutions: transforms the input, multiplies, transforms back, one band of tiles at a time.
#include <Imath/half.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "layers/conv2d.h"
#include "layers/llvmpipe.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kPiece = 3, kTaps = kPiece * kPiece;
constexpr uint32_t kWeightsLocal = 64;               // invocations of a workgroup of winograd_weights.comp
constexpr uint32_t kMultiplyLocal = 64;              // tiles of a workgroup of winograd_multiply.comp
constexpr uint32_t kTransformLocal = 64;             // tiles of a workgroup of the transforms
constexpr uint64_t kMostScratchElements = 1u << 24;  // bands are lower where they would need more
constexpr uint32_t kPaddingElements = 16;  // keeps positions from falling into the same set of a cache

struct Sizes {
  uint32_t tile, side, positions;
  uint32_t tiles_x, tile_rows;             // tiles_x even
  uint32_t band_rows, band_tiles;          // band_tiles a multiple of all workgroups
  uint32_t channels_in;                    // those of all pieces
  uint32_t parts;                          // parts of the input channels
  uint32_t outputs, blocks, channels_out;  // channels_out = outputs * blocks
  uint32_t weights_stride, transformed_stride, products_stride;
};

// A kernel of 5x5, with a row and a column of zeros, is four pieces of 3x3 side by side. So its
// convolution is a 3x3 one of four times the channels: the image as each piece sees it. A kernel of 3x3 is
// one piece.
struct Pieces {
  uint32_t kernel;

  uint32_t count() const { return winograd_channels(1, kernel); }
  // Returns the rows, or columns, from a pixel to the first that a piece reads; they wrap around.
  uint32_t first_row(uint32_t piece) const { return piece / 2 * 3 - kernel / 2; }
  uint32_t first_column(uint32_t piece) const { return piece % 2 * 3 - kernel / 2; }
  // Returns tap `k` of a piece, where at(ky, kx) has those of the kernel.
  template <typename At>
  auto tap(uint32_t piece, uint32_t k, const At& at) const {
    const uint32_t ky = piece / 2 * 3 + k / 3, kx = piece % 2 * 3 + k % 3;
    return ky < kernel && kx < kernel ? at(ky, kx) : 0;
  }
};

struct TileGrid {
  uint32_t columns, rows;
};

TileGrid tile_grid(const Conv2dShape& shape, uint32_t tile) {
  return {divide_up(shape.width, 2 * tile) * 2, divide_up(shape.height, tile)};
}

Sizes sizes_of(const Convolution& conv) {
  const Conv2dKernel& how = conv.options.how;
  const Conv2dShape shape{conv.height, conv.width, conv.channels_in, conv.channels_out, conv.options.kernel};
  const TileGrid tiles = tile_grid(shape, how.tile);
  Sizes s;
  s.tile = how.tile;
  s.side = how.tile + kPiece - 1;
  s.positions = s.side * s.side;
  s.tiles_x = tiles.columns;
  s.tile_rows = tiles.rows;
  s.band_rows = winograd_band_rows(shape, how);
  s.band_tiles = divide_up(s.band_rows * s.tiles_x, kMultiplyLocal) * kMultiplyLocal;
  s.channels_in = winograd_channels(conv.channels_in, conv.options.kernel);
  s.parts = parts_of(s.channels_in, how.channels);
  s.blocks = blocks_of(conv);
  s.outputs = divide_up(conv.channels_out, s.blocks);
  s.channels_out = s.outputs * s.blocks;
  s.weights_stride = divide_up(s.channels_out * s.channels_in, 2 * kWeightsLocal) * 2 * kWeightsLocal;
  s.transformed_stride = s.band_tiles * s.channels_in + kPaddingElements;
  s.products_stride = s.band_tiles * s.channels_out + kPaddingElements;
  return s;
}

// Writes weights in the layout of winograd_weights.comp, with zeros where channels end early.
template <typename Element>
void pack_weights(std::byte* target, const Convolution& conv, const Sizes& s) {
  auto* packed = reinterpret_cast<Element*>(target);
  std::fill_n(packed, kTaps * size_t{s.weights_stride}, Element(0));
  const Pieces pieces{conv.options.kernel};
  for (uint32_t o = 0; o < conv.channels_out; ++o) {
    for (uint32_t i = 0; i < s.channels_in; ++i) {
      const auto at = [&](uint32_t ky, uint32_t kx) {
        return conv.weight_at(o, i % conv.channels_in, ky, kx);
      };
      Element* first = packed + (size_t{o / s.outputs} * s.channels_in + i) * s.outputs + o % s.outputs;
      for (uint32_t k = 0; k < kTaps; ++k)
        first[k * size_t{s.weights_stride}] = Element(pieces.tap(i / conv.channels_in, k, at));
    }
  }
}

struct Scratch {
  Tensor transformed, products;  // hold one band at a time
};

struct Steps {
  Graph& graph;
  const Convolution& conv;
  Sizes s;
  Scratch scratch;
  Pieces pieces{conv.options.kernel};
  Tensor weights = graph.scratch(conv.name + ".weights", uint64_t{s.weights_stride} * s.positions);
  uint32_t bias = bias_constant(graph, conv, s.channels_out);
  uint32_t zeros = graph.constant(
      conv.name + ".zeros", llvmpipe::kInputVectorPixels * sizeof(float), [](std::byte* target) {
        std::fill_n(reinterpret_cast<float*>(target), llvmpipe::kInputVectorPixels, 0.0f);
      });

  // Returns the share of the whole convolution that a band is.
  double share(uint32_t first_tile_row) const {
    return double(std::min(s.band_rows, s.tile_rows - first_tile_row)) / s.tile_rows;
  }

  bool floats_by_address() const { return graph.addressed() && graph.storage() == Storage::kFloat32; }

  // Returns whether aligned pairs of floats can access rows of an image that is shuffled by `shuffle`.
  bool by_pairs(uint32_t shuffle) const { return floats_by_address() && shuffle == 1 && conv.width % 2 == 0; }

  // Returns whether two output channels, which the shuffle makes neighbours, are stored at once.
  bool by_pairs_of_outputs() const {
    return paired() && floats_by_address() && conv.options.shuffle % 2 == 0;
  }

  // Returns whether an invocation of winograd_multiply_vectors.comp computes two tiles, one vector apart.
  bool paired() const { return llvmpipe::paired_vector(graph, conv, s.band_tiles) > 0; }

  void transform_weights() const {
    const uint64_t filters_bytes = uint64_t{kTaps} * s.weights_stride * element_bytes(graph.storage());
    const uint32_t filters =
        graph.constant(conv.name + ".weight", filters_bytes, [c = conv, s = s](std::byte* target) {
          c.half ? pack_weights<Imath::half>(target, c, s) : pack_weights<float>(target, c, s);
        });
    Pass p = pass_of(graph, conv.name, shaders::kWinogradWeights,
                     {constant_binding(filters), write_binding(weights)});
    p.constants = {s.tile};
    p.set_push(params::WinogradWeights{s.weights_stride});
    p.groups = {s.weights_stride / 2 / kWeightsLocal, 1, 1};
    p.bytes = static_cast<double>(filters_bytes);
    graph.add(std::move(p));
  }

  void transform_input(uint32_t first_tile_row, uint32_t piece) const {
    uint32_t channel = piece * conv.channels_in;
    for (const Tensor& in : conv.inputs()) {
      const uint32_t u = conv.options.unshuffle, channels = in.shape.channels * u * u;
      const bool vectors = llvmpipe::input_vector(graph, conv, s.band_tiles) > 0;
      std::vector<Binding> bindings{read_binding(in)};
      if (vectors) bindings.push_back(constant_binding(zeros));
      bindings.push_back(write_binding(scratch.transformed));
      Pass p = pass_of(graph, conv.name, shaders::kWinogradInput, std::move(bindings), vectors);
      p.constants = {s.tile};
      if (!vectors) p.constants.insert(p.constants.end(), {u, by_pairs(u) && pieces.count() == 1});
      set_push(p,
               params::WinogradInput{conv.height, conv.width, graph.plane(in), graph.rows_mask(in), s.tiles_x,
                                     first_tile_row, s.channels_in, channel, s.transformed_stride,
                                     pieces.first_row(piece), pieces.first_column(piece)},
               vectors);
      p.groups = {s.band_tiles / kTransformLocal, 1, channels};
      p.bytes = share(first_tile_row) * traffic(graph, in);
      graph.add(std::move(p));
      channel += channels;
    }
  }

  void multiply(uint32_t first_tile_row, uint32_t part) const {
    const uint32_t first = part * s.channels_in / s.parts, end = (part + 1) * s.channels_in / s.parts;
    const uint32_t vector = llvmpipe::product_vector(conv.options.how, s.band_tiles);
    Binding weight = read_binding(weights);
    weight.by_address = true;
    Pass p =
        pass_of(graph, conv.name, shaders::kWinogradMultiply,
                {weight, read_binding(scratch.transformed), write_binding(scratch.products)}, vector > 0);
    p.constants = {s.tile, end - first, s.outputs, part > 0};
    if (vector > 0) {
      const uint32_t local = paired() ? kMultiplyLocal / 2 : kMultiplyLocal;
      p.constants.insert(p.constants.end(), {conv.options.how.order, vector, local, paired()});
    }
    set_push(p,
             params::WinogradMultiply{s.channels_in, first, s.blocks, s.weights_stride, s.transformed_stride,
                                      s.products_stride},
             vector > 0);
    p.groups = {s.band_tiles / kMultiplyLocal, s.blocks, s.positions};
    p.flop = share(first_tile_row) * conv.flop() / s.parts;
    p.bytes = share(first_tile_row) * double(s.weights_stride) * s.positions * sizeof(float) / s.parts;
    graph.add(std::move(p));
  }

  void transform_output(uint32_t first_tile_row) const {
    const std::vector<Tensor>& residuals = conv.options.residuals;
    std::vector<Binding> bindings{read_binding(scratch.products), constant_binding(bias),
                                  write_binding(conv.out)};
    for (uint32_t i = 0; i < kMostResiduals; ++i)
      bindings.push_back(residual_binding(conv, i, scratch.products));
    Pass p = pass_of(graph, conv.name, shaders::kWinogradOutput, std::move(bindings), paired());
    const uint32_t outputs = by_pairs_of_outputs() ? 2 : 1;
    p.constants = {s.tile, conv.options.shuffle, conv.options.relu, static_cast<uint32_t>(residuals.size()),
                   by_pairs(conv.options.shuffle) || outputs == 2};
    if (paired()) p.constants.insert(p.constants.end(), {kPairedVector, outputs});
    const Tensor& residual = residuals.empty() ? conv.out : residuals.front();
    for (const Tensor& other : residuals) {
      if (graph.rows_mask(other) != graph.rows_mask(residual))
        throw Error("layer {}: residuals keep different numbers of rows, expected the same number",
                    conv.name);
    }
    // Rows below the band belong to the next one.
    const uint32_t end = std::min(conv.height, (first_tile_row + s.band_rows) * s.tile);
    set_push(p,
             params::WinogradOutput{end, conv.width, graph.plane(conv.out), graph.rows_mask(conv.out),
                                    graph.plane(residual), graph.rows_mask(residual), s.tiles_x,
                                    first_tile_row, s.channels_out, s.products_stride},
             paired());
    p.groups = {s.band_tiles / kTransformLocal, 1, conv.channels_out / outputs};
    p.bytes = share(first_tile_row) * traffic(graph, conv.out) * (1.0 + double(residuals.size()));
    graph.add(std::move(p));
  }

  void compute(uint32_t first_tile_row) const {
    for (uint32_t piece = 0; piece < pieces.count(); ++piece) transform_input(first_tile_row, piece);
    for (uint32_t part = 0; part < s.parts; ++part) multiply(first_tile_row, part);
    transform_output(first_tile_row);
  }
};

// Puts bands of several convolutions into an order in which each finds its input's rows.
struct Schedule {
  struct Band {
    size_t conv;
    uint32_t first_tile_row;
  };
  std::span<const Convolution> convs;
  std::span<const Sizes> sizes;
  std::vector<Band> bands = {};
  std::vector<uint32_t> done = std::vector<uint32_t>(convs.size());  // tile rows of each convolution
  std::vector<uint32_t> kept =
      std::vector<uint32_t>(convs.size());  // the most rows of its output needed at once

  // Adds bands until `rows` rows of the output of convolution i are computed.
  void require(size_t i, uint32_t rows) {
    const Sizes& s = sizes[i];
    while (rows_done(i) < rows) {
      const uint32_t first_tile_row = done[i];
      done[i] = std::min(s.tile_rows, first_tile_row + s.band_rows);
      if (i > 0) {
        // A 3x3 reads one row above its own and one below.
        const uint32_t u = convs[i].options.unshuffle, first = first_tile_row * s.tile;
        require(i - 1, std::min(convs[i].height, done[i] * s.tile + 1) * u);
        kept[i - 1] = std::max(kept[i - 1], rows_done(i - 1) - (first - std::min(first, 1u)) * u);
      }
      bands.push_back({i, first_tile_row});
    }
  }

  uint32_t rows_done(size_t i) const {
    return std::min(convs[i].height, done[i] * sizes[i].tile) * convs[i].options.shuffle;
  }
};

Scratch scratch_for(Graph& graph, const std::string& name, std::span<const Sizes> sizes) {
  uint64_t transformed = 0, products = 0;
  for (const Sizes& s : sizes) {
    transformed = std::max(transformed, uint64_t{s.transformed_stride} * s.positions);
    products = std::max(products, uint64_t{s.products_stride} * s.positions);
  }
  return {graph.scratch(name + ".transformed", transformed), graph.scratch(name + ".products", products)};
}

}  // namespace

std::vector<std::array<double, 3>> winograd_filter(uint32_t tile) {
  if (tile == 2) return {{1, 0, 0}, {1. / 2, 1. / 2, 1. / 2}, {1. / 2, -1. / 2, 1. / 2}, {0, 0, 1}};
  return {{1. / 4, 0, 0},
          {-1. / 6, -1. / 6, -1. / 6},
          {-1. / 6, 1. / 6, -1. / 6},
          {1. / 24, 1. / 12, 1. / 6},
          {1. / 24, -1. / 12, 1. / 6},
          {0, 0, 1}};
}

double winograd_amplification(const ConvWeights& weights, uint32_t channels_in, uint32_t kernel,
                              Algorithm algorithm) {
  // Holds the transforms of one direction.
  struct Transforms {
    std::vector<std::array<double, 3>> filter;
    std::vector<double> input_sums;  // sums of the rows of |B^T|
    std::vector<std::vector<double>> output;
  };
  const Transforms down{winograd_filter(4),
                        {10, 10, 10, 6, 6, 10},
                        {{1, 1, 1, 1, 1, 0}, {0, 1, 1, 2, 2, 0}, {0, 1, 1, 4, 4, 0}, {0, 1, 1, 8, 8, 1}}};
  const Transforms direct{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {1, 1, 1}, {{1, 1, 1}}};
  const Transforms& across = algorithm == Algorithm::kColumns ? direct : down;
  const size_t rows = down.filter.size(), columns = across.filter.size();
  double largest = 0;
  const Pieces pieces{kernel};
  const size_t taps = size_t{kernel} * kernel;
  for (size_t o = 0; o < weights.bias.size(); ++o) {
    std::vector<double> sums(rows * columns);
    double own = 0;
    for (size_t i = 0; i < channels_in; ++i) {
      const auto g = weights.weight.subspan((o * channels_in + i) * taps, taps);
      const auto at = [&](uint32_t ky, uint32_t kx) { return g[size_t{ky} * kernel + kx]; };
      for (uint32_t piece = 0; piece < pieces.count(); ++piece) {
        for (size_t p = 0; p < sums.size(); ++p) {
          double u = 0;
          for (uint32_t k = 0; k < kTaps; ++k)
            u += down.filter[p / columns][k / 3] * across.filter[p % columns][k % 3] *
                 pieces.tap(piece, k, at);
          sums[p] += std::abs(u);
        }
      }
      for (const float value : g) own += std::abs(value);
    }
    for (const auto& row : down.output) {
      for (const auto& column : across.output) {
        double flow = 0;
        for (size_t p = 0; p < sums.size(); ++p) {
          const size_t r = p / columns, c = p % columns;
          flow += row[r] * column[c] * sums[p] * down.input_sums[r] * across.input_sums[c];
        }
        if (own > 0) largest = std::max(largest, flow / own);
      }
    }
  }
  return largest;
}

uint32_t winograd_band_rows(const Conv2dShape& shape, const Conv2dKernel& how) {
  const TileGrid tiles = tile_grid(shape, how.tile);
  if (how.band_rows > 0) return std::min(how.band_rows, tiles.rows);
  const uint32_t side = how.tile + kPiece - 1;
  const uint64_t row_elements = uint64_t{side} * side * tiles.columns *
                                (winograd_channels(shape.channels_in, shape.kernel) + shape.channels_out);
  const auto most_rows =
      static_cast<uint32_t>(std::clamp<uint64_t>(kMostScratchElements / row_elements, 1, tiles.rows));
  return std::clamp(how.band / tiles.columns, 1u, most_rows);
}

void conv2d_winograd(Graph& graph, std::span<const Convolution> convs) {
  std::vector<Sizes> sizes;
  for (const Convolution& conv : convs) sizes.push_back(sizes_of(conv));
  Schedule schedule{convs, sizes};
  schedule.require(convs.size() - 1, convs.back().out.shape.height);
  for (size_t i = 0; i + 1 < convs.size(); ++i)
    graph.keep_rows(convs[i].out, std::bit_ceil(schedule.kept[i]));
  const Scratch scratch = scratch_for(graph, convs.front().name, sizes);
  std::vector<Steps> steps;
  for (size_t i = 0; i < convs.size(); ++i) {
    steps.push_back({.graph = graph, .conv = convs[i], .s = sizes[i], .scratch = scratch});
    steps.back().transform_weights();
  }
  for (const auto& [i, first_tile_row] : schedule.bands) steps[i].compute(first_tile_row);
}

}  // namespace raymeld
