// Adds convolutions by cooperative matrices. Their shuffles are part of the same pass.
#include <Imath/half.h>

#include <algorithm>

#include "layers/conv2d.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kStep = 8;  // halves in 16 bytes, as conv2d_matrix.comp counts shared memory

// Holds the input channels as conv2d_matrix.comp counts them: those of a second input start at a multiple of
// kStep.
struct PaddedChannels {
  uint32_t first = 0, second = 0, second_start = 0;

  explicit PaddedChannels(const Convolution& conv)
      : second(conv.options.second_input ? conv.options.second_input->shape.channels : 0) {
    first = conv.channels_in - second;
    second_start = divide_up(first, kStep) * kStep;
  }
  uint32_t count() const { return second_start + second; }
  // Returns the channel of the convolution, or none between the inputs and beyond the last.
  std::optional<uint32_t> channel(uint32_t padded) const {
    if (padded < first) return padded;
    if (padded >= second_start && padded < count()) return padded - second_start + first;
    return {};
  }
};

// Writes weights in the layout of conv2d_matrix.comp, [block][chunk][output][ky][kx][channel],
// zeros where there is no channel.
void pack_weights(std::byte* target, const Convolution& conv, const MatrixTiles& tiles) {
  auto* next = reinterpret_cast<Imath::half*>(target);
  const uint32_t kernel = conv.options.kernel;
  const PaddedChannels channels(conv);
  for (uint32_t block = 0; block < conv.channels_out; block += tiles.outputs) {
    for (uint32_t chunk = 0; chunk < channels.count(); chunk += tiles.channels) {
      for (uint32_t o = block; o < block + tiles.outputs; ++o) {
        for (uint32_t tap = 0; tap < kernel * kernel; ++tap) {
          for (uint32_t i = chunk; i < chunk + tiles.channels; ++i) {
            const std::optional<uint32_t> channel = channels.channel(i);
            const bool present = o < conv.channels_out && channel;
            *next++ = present ? conv.weight_at(o, *channel, tap / kernel, tap % kernel) : 0.0f;
          }
        }
      }
    }
  }
}

uint64_t shared_bytes(const MatrixTiles& tiles, uint32_t kernel) {
  constexpr uint64_t kStepBytes = 16;
  const uint64_t border = kernel - 1;
  const uint64_t pixels = (uint64_t{tiles.subgroups} * tiles.rows + border) * (kMatrixColumns + border);
  const uint64_t tile = pixels * (tiles.channels / kStep + 1) * kStepBytes;
  const uint64_t weights =
      tiles.outputs * (uint64_t{kernel} * kernel * tiles.channels / kStep + 1) * kStepBytes;
  const uint64_t sums = uint64_t{tiles.subgroups} * tiles.matrix.m * (kMatrixColumns / 4 + 2) * kStepBytes;
  return std::max(tile, sums) + weights;
}

// Returns how many values of a row an invocation stores at once: they must be aligned in all rows and planes.
uint32_t run_of(const Graph& graph, const Convolution& conv) {
  for (const uint32_t run : {4u, 2u}) {
    if (conv.options.shuffle * conv.width % run == 0 && graph.plane(conv.out) % run == 0) return run;
  }
  return 1;
}

}  // namespace

static_assert(kMatrixColumns == RAYMELD_MATRIX_COLUMNS);

bool is_possible(const MatrixTiles& tiles, uint32_t kernel) {
  constexpr uint32_t kMost = 256;  // limit of each size; keeps products small
  const CooperativeMatrix& matrix = tiles.matrix;
  for (const uint32_t size : {matrix.m, matrix.n, matrix.k, matrix.subgroup_size, tiles.outputs, tiles.rows,
                              tiles.subgroups, tiles.channels}) {
    if (size == 0 || size > kMost) return false;
  }
  // Rows of shuffled pixels come from up to 8 outputs, which one matrix must hold.
  return kMatrixColumns % matrix.n == 0 && matrix.m % 8 == 0 && matrix.k % kStep == 0 &&
         tiles.outputs % matrix.m == 0 && tiles.channels % matrix.k == 0 &&
         tiles.subgroups * matrix.subgroup_size <= matrix.max_invocations &&
         shared_bytes(tiles, kernel) <= matrix.max_shared_bytes;
}

void conv2d_matrix(Graph& graph, const Convolution& conv) {
  MatrixTiles tiles = conv.options.how.matrix;
  const CooperativeMatrix& matrix = tiles.matrix;
  const uint32_t kernel = conv.options.kernel;
  if (!conv.half) throw Error("layer {}: cooperative matrices need 16-bit storage", conv.name);
  if (!is_possible(tiles, kernel)) {
    throw Error(
        "layer {}: {} outputs x {} rows x {} subgroups, {} channels are impossible with matrices of "
        "{}x{}x{} and {} bytes of shared memory",
        conv.name, tiles.outputs, tiles.rows, tiles.subgroups, tiles.channels, matrix.m, matrix.n, matrix.k,
        matrix.max_shared_bytes);
  }
  // Limits the tiles to the channels that there are.
  tiles.outputs = std::min(tiles.outputs, divide_up(conv.channels_out, matrix.m) * matrix.m);
  const PaddedChannels channels(conv);
  tiles.channels = std::min(tiles.channels, divide_up(channels.count(), matrix.k) * matrix.k);
  const uint32_t blocks = divide_up(conv.channels_out, tiles.outputs),
                 chunks = divide_up(channels.count(), tiles.channels);
  const uint64_t weight_bytes =
      sizeof(Imath::half) * kernel * kernel * blocks * tiles.outputs * chunks * tiles.channels;
  const uint32_t weights = graph.constant(conv.name + ".weight", weight_bytes,
                                          [=](std::byte* target) { pack_weights(target, conv, tiles); });
  const auto residuals = static_cast<uint32_t>(conv.options.residuals.size());

  Pass pass;
  pass.name = conv.name;
  pass.shader = &shaders::kConv2dMatrix;
  pass.matrix = matrix;
  pass.constants = {tiles.subgroups * matrix.subgroup_size,
                    tiles.subgroups,
                    matrix.m,
                    matrix.n,
                    matrix.k,
                    tiles.outputs / matrix.m,
                    tiles.rows,
                    tiles.channels,
                    kernel,
                    conv.options.relu,
                    residuals,
                    conv.options.unshuffle,
                    conv.options.shuffle,
                    conv.options.second_input.has_value(),
                    run_of(graph, conv)};
  pass.bindings = {constant_binding(weights), constant_binding(bias_constant(graph, conv, conv.channels_out)),
                   read_binding(conv.in), write_binding(conv.out)};
  for (uint32_t i = 0; i < kMostResiduals; ++i) pass.bindings.push_back(residual_binding(conv, i, conv.in));
  pass.bindings.push_back(read_binding(conv.options.second_input.value_or(conv.in)));
  pass.set_push(params::Conv2d{conv.height, conv.width, graph.plane(conv.in), graph.plane(conv.out),
                               conv.channels_in, channels.first, conv.channels_out});
  pass.groups = {divide_up(conv.width, kMatrixColumns), divide_up(conv.height, tiles.subgroups * tiles.rows),
                 blocks};
  pass.flop = conv.flop();
  pass.bytes = tensor_bytes(graph, conv) + double(weight_bytes);
  pass.loop_trips = chunks;
  graph.add(std::move(pass));
}

}  // namespace raymeld
