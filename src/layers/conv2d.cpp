#include "layers/conv2d.h"

#include <Imath/half.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "layers/llvmpipe.h"
#include "params.h"

namespace raymeld {
namespace {

constexpr uint32_t kLocalX = 32, kLocalY = 2;  // workgroups of conv2d.comp and conv2d_columns.comp
// An invocation of conv2d.comp computes kRows pixels. A 5x5 reads more, so that fewer fit into registers.
constexpr uint32_t kRows = 4, kRowsOf5x5 = 2;
constexpr uint32_t kColumns = 2;  // columns of an invocation of conv2d_columns.comp

// Lists the input channels whose products conv2d.comp adds together: one in 32 bits, two of the same input in
// 16 bits. The last of an odd number is there twice.
std::vector<std::array<uint32_t, 2>> channel_groups(const Convolution& conv) {
  std::vector<std::array<uint32_t, 2>> groups;
  uint32_t first = 0;
  for (const Tensor& in : conv.inputs()) {
    const uint32_t end = first + in.shape.channels * conv.options.unshuffle * conv.options.unshuffle;
    for (uint32_t i = first; i < end; i += conv.half ? 2 : 1)
      groups.push_back({i, conv.half ? std::min(i + 1, end - 1) : i});
    first = end;
  }
  return groups;
}

// Returns a weight for each of two channels. Where they are one channel, the weights add up to its weight.
// Halves of a small weight would be subnormal, which a device may flush, so the first takes all of it.
std::array<Imath::half, 2> pair_of_weights(const Convolution& conv, uint32_t o,
                                           const std::array<uint32_t, 2>& channels, uint32_t ky,
                                           uint32_t kx) {
  const float first = conv.weight_at(o, channels[0], ky, kx);
  if (channels[0] != channels[1]) return {first, conv.weight_at(o, channels[1], ky, kx)};
  const float part = std::abs(first) < 0x1p-13f ? first : first / 2;
  return {part, first - part};
}

// Writes weights in the layout of conv2d.comp, which has so many `lanes` of output channels.
void pack_weights(std::byte* target, const Convolution& conv, uint32_t lanes) {
  const auto put = [&target](const auto& value) {
    std::memcpy(target, &value, sizeof value);
    target += sizeof value;
  };
  const auto groups = channel_groups(conv);
  for (uint32_t block = 0; block < divide_up(conv.channels_out, lanes); ++block) {
    for (const auto& channels : groups) {
      for (uint32_t kx = 0; kx < conv.options.kernel; ++kx) {
        for (uint32_t ky = 0; ky < conv.options.kernel; ++ky) {
          for (uint32_t o = block * lanes; o < (block + 1) * lanes; ++o) {
            const bool padding = o >= conv.channels_out;
            if (conv.half) {
              put(padding ? std::array<Imath::half, 2>{} : pair_of_weights(conv, o, channels, ky, kx));
            } else {
              put(padding ? 0.0f : conv.weight_at(o, channels[0], ky, kx));
            }
          }
        }
      }
    }
  }
}

Convolution make_convolution(const Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
                             const ConvWeights& weights, const Conv2dOptions& options) {
  const uint32_t u = options.unshuffle, s = options.shuffle, kernel = options.kernel;
  if (kernel != 1 && kernel != 3 && kernel != 5)
    throw Error("layer {}: kernel {}, expected 1, 3 or 5", name, kernel);
  if (kernel == 5 && !options.how.computes(kernel))
    throw Error("layer {}: a kernel of 5, expected the direct one or Winograd", name);
  const uint32_t second = options.second_input ? options.second_input->shape.channels : 0;
  if (second && (u > 1 || options.second_input->shape.height != in.shape.height ||
                 options.second_input->shape.width != in.shape.width)) {
    throw Error("layer {}: inputs of {}x{} and {}x{}, unshuffled by {}, expected the same size and 1", name,
                in.shape.height, in.shape.width, options.second_input->shape.height,
                options.second_input->shape.width, u);
  }
  const auto factor = [&](const Tensor& from) {
    return std::ldexp(1.0f, graph.exponent(from) - graph.exponent(out));
  };
  Convolution conv{.name = name,
                   .in = in,
                   .out = out,
                   .options = options,
                   .height = in.shape.height / u,
                   .width = in.shape.width / u,
                   .channels_in = (in.shape.channels + second) * u * u,
                   .channels_out = out.shape.channels * s * s,
                   .weights = weights,
                   .half = graph.storage() == Storage::kFloat16,
                   .in_factor = factor(in),
                   .second_factor = options.second_input ? factor(*options.second_input) : 1,
                   .bias_factor = std::ldexp(1.0f, -graph.exponent(out))};
  if (in.shape.height % u || in.shape.width % u || conv.height * s != out.shape.height ||
      conv.width * s != out.shape.width) {
    throw Error("layer {}: {}x{} in, {}x{} out, expected the same size after shuffles by {} and {}", name,
                in.shape.height, in.shape.width, out.shape.height, out.shape.width, u, s);
  }
  const size_t expected = size_t{kernel} * kernel * conv.channels_in * conv.channels_out;
  if (weights.weight.size() != expected) {
    throw Error("layer {}: {} weights, expected {}x{}x{}x{}", name, weights.weight.size(), conv.channels_out,
                conv.channels_in, kernel, kernel);
  }
  if (weights.bias.size() != conv.channels_out) {
    throw Error("layer {}: {} biases, expected {}", name, weights.bias.size(), conv.channels_out);
  }
  if (options.residuals.size() > kMostResiduals)
    throw Error("layer {}: more than {} residuals", name, kMostResiduals);
  for (const Tensor& residual : options.residuals) {
    if (residual.shape != out.shape) throw Error("layer {}: a residual's shape is not the output's", name);
    if (graph.exponent(residual) != graph.exponent(out))
      throw Error("layer {}: a residual's exponent is not the output's", name);
  }
  return conv;
}

// Writes weights in the layout of conv2d_columns.comp, with so many `lanes` of output channels.
void pack_columns(std::byte* target, const Convolution& conv, uint32_t lanes) {
  auto* next = reinterpret_cast<float*>(target);
  const std::vector<std::array<double, 3>> transform = winograd_filter(conv.options.how.tile);
  for (uint32_t block = 0; block < divide_up(conv.channels_out, lanes); ++block) {
    for (uint32_t i = 0; i < conv.channels_in; ++i) {
      for (uint32_t kx = 0; kx < 3; ++kx) {
        for (const auto& row : transform) {
          for (uint32_t o = block * lanes; o < (block + 1) * lanes; ++o) {
            double sum = 0;
            for (uint32_t ky = 0; ky < 3 && o < conv.channels_out; ++ky)
              sum += row[ky] * conv.weight_at(o, i, ky, kx);
            *next++ = static_cast<float>(sum);
          }
        }
      }
    }
  }
}

// Holds how conv2d.comp or conv2d_columns.comp computes a convolution.
struct Blocked {
  const Shader* shader;
  uint64_t weights_of_lane;  // weights of 4 bytes, of an output channel or a pair of halves of it
  void (*pack)(std::byte* target, const Convolution& conv, uint32_t lanes);
  uint32_t first_constant;  // the side of the kernel, or of the tile
  uint32_t rows, columns;   // pixels of an invocation
  size_t trips;             // of the loops over the input channels
};

// Adds a convolution whose invocations each compute a block of output channels of some pixels.
void blocked(Graph& graph, const Convolution& conv, const Blocked& how) {
  const uint32_t vectors = conv.channels_out > 4 ? 2 : 1;
  const uint32_t lanes = 4 * vectors, blocks = divide_up(conv.channels_out, lanes);
  const uint64_t weight_bytes = uint64_t{blocks} * lanes * how.weights_of_lane * sizeof(float);
  const uint32_t weights = graph.constant(conv.name + ".weight", weight_bytes,
                                          [=](std::byte* target) { how.pack(target, conv, lanes); });

  Pass pass;
  pass.name = conv.name;
  pass.shader = how.shader;
  pass.constants = {how.first_constant,
                    vectors,
                    how.rows,
                    conv.options.relu,
                    static_cast<uint32_t>(conv.options.residuals.size()),
                    conv.options.second_input.has_value(),
                    conv.options.unshuffle,
                    conv.options.shuffle};
  pass.bindings = {constant_binding(weights), constant_binding(bias_constant(graph, conv, blocks * lanes)),
                   read_binding(conv.in), write_binding(conv.out)};
  for (uint32_t i = 0; i < kMostResiduals; ++i) pass.bindings.push_back(residual_binding(conv, i, conv.in));
  pass.bindings.push_back(read_binding(conv.options.second_input.value_or(conv.in)));
  pass.set_push(params::Conv2d{conv.height, conv.width, graph.plane(conv.in), graph.plane(conv.out),
                               conv.channels_in, conv.in.shape.channels, conv.channels_out});
  pass.groups = {divide_up(conv.width, kLocalX * how.columns), divide_up(conv.height, kLocalY * how.rows),
                 blocks};
  pass.flop = conv.flop();
  pass.bytes = tensor_bytes(graph, conv) + double(weight_bytes);
  pass.loop_trips = double(how.trips) / double(conv.inputs().size());
  graph.add(std::move(pass));
}

void direct(Graph& graph, const Convolution& conv) {
  const uint32_t kernel = conv.options.kernel;
  const size_t groups = channel_groups(conv).size();
  blocked(graph, conv,
          {.shader = &shaders::kConv2d,
           .weights_of_lane = groups * kernel * kernel,
           .pack = pack_weights,
           .first_constant = kernel,
           .rows = kernel == 5 ? kRowsOf5x5 : kRows,
           .columns = 1,
           .trips = groups});
}

void by_columns(Graph& graph, const Convolution& conv) {
  const uint32_t tile = conv.options.how.tile;
  blocked(graph, conv,
          {.shader = &shaders::kConv2dColumns,
           .weights_of_lane = uint64_t{conv.channels_in} * 3 * (tile + 2),
           .pack = pack_columns,
           .first_constant = tile,
           .rows = tile,
           .columns = kColumns,
           .trips = conv.channels_in});
}

}  // namespace

std::vector<Tensor> Convolution::inputs() const {
  return options.second_input ? std::vector{in, *options.second_input} : std::vector{in};
}

float Convolution::weight_at(uint32_t o, uint32_t i, uint32_t ky, uint32_t kx) const {
  const bool is_second = options.second_input && i >= channels_in - options.second_input->shape.channels;
  const float factor = is_second ? second_factor : in_factor;
  const float own =
      weights.weight[((size_t{o} * channels_in + i) * options.kernel + ky) * options.kernel + kx];
  const float value = own * factor;
  if (!half) return value;
  if (std::abs(value) > 65504.0f)
    throw Error("layer {}: weight {}, stored times {}, does not fit 16 bits; use --precision fp32", name, own,
                factor);
  return Imath::half(value);
}

uint32_t bias_constant(Graph& graph, const Convolution& conv, uint32_t padded_count) {
  const uint64_t size_bytes = uint64_t{padded_count} * sizeof(float);
  return graph.constant(conv.name + ".bias", size_bytes, [=](std::byte* target) {
    std::memset(target, 0, size_bytes);
    auto* biases = reinterpret_cast<float*>(target);
    for (uint32_t o = 0; o < conv.channels_out; ++o)
      biases[o] = static_cast<float>(conv.weights.bias_of(o) * conv.bias_factor);
  });
}

uint32_t parts_of(uint32_t channels, uint32_t most) {
  const uint32_t fewest = divide_up(channels, most);
  for (uint32_t parts = fewest; 2 * parts <= 3 * fewest; ++parts) {
    if (channels % parts == 0) return parts;
  }
  return fewest;
}

uint32_t blocks_of(const Convolution& conv) {
  return std::min(divide_up(conv.channels_out, conv.options.how.outputs), llvmpipe::kUniformNumbers);
}

double tensor_bytes(const Graph& graph, const Convolution& conv) {
  double bytes = traffic(graph, conv.out) * (1.0 + double(conv.options.residuals.size()));
  for (const Tensor& in : conv.inputs()) bytes += traffic(graph, in);
  return bytes;
}

Binding residual_binding(const Convolution& conv, uint32_t i, const Tensor& other) {
  return read_binding(i < conv.options.residuals.size() ? conv.options.residuals[i] : other);
}

void conv2d(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
            const ConvWeights& weights, const Conv2dOptions& options) {
  conv2d_chain(graph, std::array{Conv2dLink{name, in, out, weights, options}});
}

void conv2d_chain(Graph& graph, std::span<const Conv2dLink> links) {
  std::vector<Convolution> run;  // Winograd convolutions that follow each other
  const auto end_run = [&] {
    if (!run.empty()) conv2d_winograd(graph, run);
    run.clear();
  };
  for (const auto& [name, in, out, weights, options] : links) {
    const Convolution conv = make_convolution(graph, name, in, out, weights, options);
    const Algorithm algorithm = options.how.algorithm;
    // The rows that a chain keeps are those that a 3x3 reads.
    if (algorithm != Algorithm::kWinograd || options.kernel != 3 || graph.keep()) end_run();
    switch (algorithm) {
      case Algorithm::kDirect:
        direct(graph, conv);
        break;
      case Algorithm::kPointwise:
        if (options.kernel != 1)
          throw Error("layer {0}: the pointwise kernel is for 1x1, not for {1}x{1}", name, options.kernel);
        options.unshuffle > 1 ? conv2d_pointwise_unshuffled(graph, conv) : conv2d_pointwise(graph, conv);
        break;
      case Algorithm::kColumns:
      case Algorithm::kWinograd:
        if (options.kernel == 1 || (options.how.tile != 2 && options.how.tile != 4))
          throw Error("layer {}: no Winograd F({}, {}), expected F(2, 3) or F(4, 3)", name, options.how.tile,
                      options.kernel);
        algorithm == Algorithm::kColumns ? by_columns(graph, conv) : run.push_back(conv);
        if (options.kernel != 3) end_run();
        break;
      case Algorithm::kMatrix:
        conv2d_matrix(graph, conv);
        break;
    }
  }
  end_run();
}

}  // namespace raymeld
