// The menu: one function for each layer, of the same name as its shader, its scalar reference and its tests.
// Each adds passes to the graph. Shapes are checked when the graph is built; an Error names the layer.
#pragma once

#include <span>
#include <string>

#include "engine/graph.h"

namespace raymeld {

// Weights of a convolution: [channels_out][channels_in][kernel][kernel], as PyTorch keeps them, and a bias
// [channels_out]. Not owned: they must outlive every Program made of the graph.
struct ConvWeights {
  std::span<const float> weight;
  std::span<const float> bias;
};

struct Conv2dOptions {
  uint32_t kernel = 3;  // 1 or 3
  bool relu = false;
  std::span<const Tensor> residuals = {};  // at most three, of the output's shape; added after the activation
};

// (h, w, in.channels) -> (h, w, out.channels); stride 1, zero padding. `out` may be a slice of the tensor
// that `in` is another slice of.
void conv2d(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
            const ConvWeights& weights, const Conv2dOptions& options);

// (r h, r w, c) -> (h, w, r r c), PyTorch's channel order: r r c + r dy + dx. r follows from the shapes.
void space_to_depth(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out);

// (h, w, r r c) -> (r h, r w, c), the inverse.
void pixel_shuffle(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out);

// How a channel of an input image is brought into the network's range.
enum class ChannelKind : uint32_t { kRadiance, kAlbedo, kNormal, kVariance };
enum class Transfer { kLinear, kLog };

// From the image in `slot`, scene linear, to (h, w, c). NaN becomes 0, infinities are clamped like any value:
// radiance times the recording's exposure, and variance times its square, to [0, clip], then y = x or
// y = log(1 + 8 x) / 3; albedo to [0, 1]; normals to [-1, 1].
void encode(Graph& graph, const std::string& name, FrameSlot slot, const Tensor& out,
            std::span<const ChannelKind> kinds, Transfer transfer, float clip);

struct DecodeOptions {
  Transfer transfer = Transfer::kLinear;
  const Tensor* base = nullptr;  // the encoded LRHS (h, w, c), upsampled and added; null: none
  uint32_t scale = 1;
  float phase = 0;  // of LRHS samples, in full-size pixels: 0, or (scale - 1) / 2 for a low-resolution render
};

// From (H, W, c) to the image in FrameSlot::kFused: adds the bilinearly upsampled base, inverts the transfer,
// divides by the recording's exposure, clamps to [0, 65504].
void decode(Graph& graph, const std::string& name, const Tensor& in, const DecodeOptions& options);

}  // namespace raymeld
