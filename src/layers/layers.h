// The menu: one function for each layer, of the same name as its shader, its scalar reference and its
// cases in src/conform. Each adds passes to the graph. Shapes are checked when the graph is built; an Error
// names the layer.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "layers/frame_slots.h"

namespace raymeld {

// Weights of a convolution: [channels_out][channels_in][kernel][kernel], as PyTorch keeps them, and a bias
// [channels_out]. Not owned: they must outlive every Program made of the graph.
struct ConvWeights {
  std::span<const float> weight;
  std::span<const float> bias;
};

inline constexpr uint32_t kMatrixColumns = 32;  // pixels of a row of conv2d_matrix.comp's workgroups

// How conv2d_matrix.comp cuts a convolution up, of 16-bit storage, with what the device has for it.
struct MatrixTiles {
  CooperativeMatrix matrix;
  uint32_t outputs = 64;   // output channels of a workgroup; a multiple of matrix.m
  uint32_t rows = 2;       // of kMatrixColumns pixels, of a subgroup
  uint32_t subgroups = 4;  // of a workgroup
  uint32_t channels = 16;  // input channels in shared memory at a time; a multiple of matrix.k

  bool operator==(const MatrixTiles&) const = default;
};

// Whether the shader can, and finds room in shared memory.
bool is_possible(const MatrixTiles& tiles, uint32_t kernel);

// The kernels of a convolution; which of them is fastest depends on the device.
enum class Algorithm {
  kDirect,     // conv2d.comp, which any device runs; sums in the order of the equation
  kPointwise,  // pointwise.comp, for a 1x1, or pointwise_unshuffled.comp where the 1x1 is unshuffled
  kWinograd,   // winograd_*.comp, for a 3x3
  kMatrix      // conv2d_matrix.comp, for either, with 16-bit storage; shuffles in its loads and stores
};

// A kernel and its parameters. kMatrix needs
// DeviceInfo::cooperative_matrix; it sums in 32 bits, but a device may truncate where others round.
struct Conv2dKernel {
  Algorithm algorithm = Algorithm::kDirect;
  // kWinograd: the m of F(m, 3), 2 or 4. Errors are in proportion to the largest value of a tile, with 4 more
  // than with 2. See shaders/conv2d/winograd.glsl.
  uint32_t tile = 4;
  // The other parameters of kWinograd and of kPointwise; pointwise_unshuffled.comp has none.
  uint32_t outputs = 16;   // output channels of an invocation
  uint32_t channels = 64;  // at most so many input channels are summed up by one dispatch
  uint32_t band = 256;  // about so many tiles or pixels are computed at a time, so that they stay in a cache
  uint32_t band_rows = 0;  // kWinograd: rows of tiles instead, the winograd_band_rows() of another size; or 0
  uint32_t vector = 0;     // DeviceInfo::vector_lanes, for the shaders of shaders/llvmpipe; or 0
  uint32_t order = 8;      // with `vector`: loads are kept in order every so many channels; 0: never
  MatrixTiles matrix = {};  // kMatrix

  bool operator==(const Conv2dKernel&) const = default;
  // Returns whether the shaders find weights by address, so that the device must have buffer addresses.
  bool needs_addresses() const {
    return algorithm == Algorithm::kPointwise || algorithm == Algorithm::kWinograd;
  }
  // Returns the m of F(m, 3), or 0 for other algorithms.
  uint32_t winograd_tile() const { return algorithm == Algorithm::kWinograd ? tile : 0; }
};

// The Conv2dKernel::vector with which an invocation computes the products of two tiles.
inline constexpr uint32_t kPairedVector = 8;

// What the choice of a kernel may depend on; height, width and channels are those between the shuffles.
struct Conv2dShape {
  uint32_t height, width, channels_in, channels_out, kernel;
  uint32_t most_tile = 4;  // 2 where F(4, 3) would not be accurate enough

  auto operator<=>(const Conv2dShape&) const = default;
  // Multiply-adds count as two.
  double flop() const { return 2.0 * height * width * channels_in * channels_out * kernel * kernel; }
};
using Conv2dChoice = std::function<Conv2dKernel(const Conv2dShape&)>;

// How many rows of tiles a convolution by minimal filtering works on at a time.
uint32_t winograd_band_rows(const Conv2dShape& shape, const Conv2dKernel& how);

// The direct kernel for every shape.
inline Conv2dKernel conv2d_direct(const Conv2dShape&) { return {}; }

// How a graph is computed on a device; the default runs on all of them.
struct Kernels {
  bool addressed = false;  // see Graph
  uint32_t vector = 0;     // see Graph::read_vectors
  Conv2dChoice conv2d = conv2d_direct;
};

// Of a 3x3 convolution by F(4, 3): how many times as large as its direct sums' what flows through its
// transforms may become, with inputs of equal size: the largest over the outputs of |A^T| (|G g G^T| |B^T| 1
// |B|) |A| over sum |g|. Rounding errors grow by as much, and reach all pixels of a tile.
double winograd_amplification(const ConvWeights& weights, uint32_t channels_in);

struct Conv2dOptions {
  uint32_t kernel = 3;  // 1 or 3
  bool relu = false;
  std::vector<Tensor> residuals = {};  // at most three, of the output's shape; added after the activation
  std::optional<Tensor> second_input =
      {};                  // of the input's size, with further input channels; not if unshuffled
  uint32_t unshuffle = 1;  // reads space_to_depth() of `in` by this
  uint32_t shuffle = 1;    // writes pixel_shuffle() by this to `out`
  Conv2dKernel how = {};
  // Of the weights' input channels, before `unshuffle`, the value of each that is the same everywhere and in
  // no tensor; those without are the channels of `in` and `behind`. Empty: all are.
  std::vector<std::optional<float>> constants = {};
};

// (h, w, in.channels) -> (h, w, out.channels); stride 1, zero padding. `out` may be a slice of the tensor
// that `in` is another slice of.
void conv2d(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
            const ConvWeights& weights, const Conv2dOptions& options);

// The arguments of conv2d().
struct Conv2dLink {
  std::string name;
  Tensor in, out;
  ConvWeights weights;
  Conv2dOptions options;
};

// One convolution after another, of which each reads what the one before wrote, and nothing else does.
// Where both are by minimal filtering they take turns, band by band, and of the tensor between them only
// some rows are in memory at a time, unless the graph is to keep() it.
void conv2d_chain(Graph& graph, std::span<const Conv2dLink> links);

// (r h, r w, c) -> (h, w, r r c), PyTorch's channel order: r r c + r dy + dx. r follows from the shapes.
void space_to_depth(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out);

// (h, w, r r c) -> (r h, r w, c), the inverse.
void pixel_shuffle(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out);

// Writes the recording's exposure, for what runs behind it: exposure_of() LRHS (h, w, 3), in 32 bits, by sums
// in a fixed order. What is subnormal may count as 0.
void exposure(Graph& graph, const std::string& name, uint32_t height, uint32_t width, float key);

// How a channel of an input image is brought into the network's range.
enum class ChannelKind : uint32_t { kRadiance, kAlbedo, kNormal, kVariance };
enum class Transfer { kLinear, kLog };

// Where a channel comes from: a channel of the image or, already encoded, a value.
struct EncodedChannel {
  ChannelKind kind = ChannelKind::kRadiance;
  uint32_t channel = 0;
  std::optional<float> value = {};
};

// From channels of the image in `slot`, scene linear, to (h, w, c). NaN becomes 0, infinities are clamped
// like any value: radiance times the recording's exposure, and variance times its square, to [0, clip], then
// y = x or y = log(1 + 8 x) / 3; albedo to [0, 1]; normals to [-1, 1].
void encode(Graph& graph, const std::string& name, FrameSlot slot, const Tensor& out,
            std::span<const EncodedChannel> channels, Transfer transfer, float clip);

// The variance of HRLS's color to (H, W, 3), encoded as encode() does: for each channel the mean over 3x3
// pixels, edges replicated, of the squared difference from their mean; what is not finite counts as 0.
void variance(Graph& graph, const std::string& name, const Tensor& out, Transfer transfer, float clip);

// What LRHS has beyond the clip, scene linear (h, w, c): max(0, x - clip / exposure), at most 65504; of NaN
// 0.
void above_clip(Graph& graph, const std::string& name, const Tensor& out, float clip);

struct DecodeOptions {
  Transfer transfer = Transfer::kLinear;
  const Tensor* base = nullptr;  // the encoded LRHS (h, w, c), upsampled and added; null: none
  uint32_t scale = 1;
  float phase = 0;  // of LRHS samples, in full-size pixels: 0, or (scale - 1) / 2 for a low-resolution render
  const Tensor* above_clip = nullptr;  // (h, w, c), see highlights(); null: none
  float clip = 0;                      // that of the highlights
};

// From (H, W, c) to the image in kFusedSlot: adds the bilinearly upsampled base, inverts the transfer,
// divides by the recording's exposure, adds the highlights, clamps to [0, 65504]. The highlight of a pixel is
// the mean of the four LRHS samples around it, weighted bilinearly and each by itself; what is added of it
// rises from nothing where the output, still exposed, is an eighth of the clip to all of it at a quarter.
void decode(Graph& graph, const std::string& name, const Tensor& in, const DecodeOptions& options);

// The joint base: the output is mixed, pixel by pixel, of LRHS, of LRHS with the albedo of HRLS and of both
// filtered. All layers below read encoded images.
struct JointOptions {
  Transfer transfer = Transfer::kLinear;
  uint32_t scale = 1;
  float phase = 0;           // as in DecodeOptions
  float lrhs_certainty = 0;  // what a pixel of LRHS counts where one of HRLS counts 1
};

// LRHS (h, w, 3) over the albedo (H, W, 3) + 0.4, encoded again, then the mean of 3x3 of its pixels by a
// level of joint_filter() without certainty and brightness. Albedo and normal (H, W, 3) are those of a cell's
// top-left pixel, or where phase > 0 the mean of the cell.
void irradiance(Graph& graph, const std::string& name, const Tensor& lrhs, const Tensor& albedo,
                const Tensor& normal, const Tensor& out, const JointOptions& options);

// (H, W, 5): ln(1 + 0.2 x) / 0.2, x being the light; the certainty of it; and a brightness, the luminance of
// the bilinearly upsampled irradiance. lrhs (h, w, 6) is color and irradiance().
// Light is color over albedo + 0.4: of HRLS, where a pixel brighter than 20 times its second brightest
// neighbour + 0.001 is darkened to that, its certainty 1; and of LRHS, with lrhs_certainty at the pixels it
// was rendered of, or where phase > 0 with lrhs_certainty / scale^2 everywhere, its irradiance upsampled. x
// is the mean of both by certainty, whose sum is that of x.
void demodulate(Graph& graph, const std::string& name, const Tensor& color, const Tensor& albedo,
                const Tensor& lrhs, const Tensor& out, const JointOptions& options);

// (H, W, 4) -> (H, W, 4), light and its certainty: a level of the a-trous filter of Dammertz et al. 2010,
// with the binomial 3x3 kernel at `step` pixels, edges replicated, times exp(-|difference of albedo / 1.5,
// normal / 1.2, brightness / 0.0667|^2). Light is weighted by its certainty as well, of which the mean is
// passed on: normalized convolution, Knutsson and Westin 1993.
void joint_filter(Graph& graph, const std::string& name, const Tensor& in, const Tensor& albedo,
                  const Tensor& normal, const Tensor& brightness, const Tensor& out, uint32_t step);

// Filtered light (H, W, 3) times the albedo + 0.4, encoded.
void remodulate(Graph& graph, const std::string& name, const Tensor& light, const Tensor& albedo,
                const Tensor& out, Transfer transfer);

// rec (H, W, 8), a residual and five logits; lrhs (h, w, 6), color and irradiance; candidates (H, W, 9),
// three times relight() -> (H, W, 3): the residual plus the candidates, weighted by the softmax of the
// logits. The first two candidates are the upsampled LRHS, and the upsampled irradiance times the albedo +
// 0.4.
void mix(Graph& graph, const std::string& name, const Tensor& rec, const Tensor& lrhs, const Tensor& albedo,
         const Tensor& candidates, const Tensor& out, const JointOptions& options);

}  // namespace raymeld
