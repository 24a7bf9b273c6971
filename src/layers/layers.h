// Declares a function for each layer, of the same name as its shader, its scalar reference and its cases in
// src/conform. Each adds passes to the graph and checks shapes; an Error names the layer.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "layers/frame_slots.h"

namespace raymeld {

// Holds weights of a convolution, [channels_out][channels_in][kernel][kernel] as PyTorch keeps them, and a
// bias [channels_out]. It does not own them: they must outlive every Program made of the graph.
struct ConvWeights {
  std::span<const float> weight;
  std::span<const float> bias;
  // The bias grows by bias_by_spp [channels_out] times log_spp; empty where the layer knows no sample count.
  std::span<const float> bias_by_spp = {};
  float log_spp = 0;  // base 2

  double bias_of(size_t o) const {
    return bias_by_spp.empty() ? bias[o] : bias[o] + double{bias_by_spp[o]} * log_spp;
  }
};

inline constexpr uint32_t kMatrixColumns = 32;  // width of conv2d_matrix.comp's workgroups in pixels

// Says how conv2d_matrix.comp divides a convolution with 16-bit storage, and which matrices the device has.
struct MatrixTiles {
  CooperativeMatrix matrix;
  uint32_t outputs = 64;   // output channels of a workgroup; a multiple of matrix.m
  uint32_t rows = 2;       // rows of kMatrixColumns pixels of a subgroup
  uint32_t subgroups = 4;  // subgroups of a workgroup
  uint32_t channels = 16;  // input channels in shared memory at a time; a multiple of matrix.k

  bool operator==(const MatrixTiles&) const = default;
};

// Returns whether conv2d_matrix.comp can use these tiles and finds room for them in shared memory.
bool is_possible(const MatrixTiles& tiles, uint32_t kernel);

// Lists the kernels of a convolution; which of them is fastest depends on the device.
enum class Algorithm {
  kDirect,     // conv2d.comp, which any device runs
  kPointwise,  // pointwise.comp, for a 1x1, or pointwise_unshuffled.comp where its input is unshuffled
  kColumns,    // conv2d_columns.comp, for a 3x3
  kWinograd,   // winograd_*.comp, for a 3x3, or for a 5x5 as four of these
  kMatrix      // conv2d_matrix.comp, for a 1x1 or a 3x3, with 16-bit storage
};

// Holds a kernel and its parameters. kMatrix needs DeviceInfo::cooperative_matrix; it sums in 32 bits, but a
// device may truncate where others round.
struct Conv2dKernel {
  Algorithm algorithm = Algorithm::kDirect;
  // The m of F(m, 3), of kColumns in one dimension and of kWinograd in two, is 2 or 4. Errors are in
  // proportion to the largest value of a tile, with 4 more than with 2. See shaders/conv2d/winograd.glsl.
  uint32_t tile = 4;
  // These are parameters of kWinograd and of kPointwise; pointwise_unshuffled.comp has none.
  uint32_t outputs = 16;    // output channels of an invocation
  uint32_t channels = 64;   // the most input channels that one dispatch sums up
  uint32_t band = 256;      // approximate tiles or pixels at a time, few enough to stay in a cache
  uint32_t band_rows = 0;   // kWinograd: rows of tiles instead of `band`, from winograd_band_rows(); or 0
  uint32_t vector = 0;      // DeviceInfo::vector_lanes, for the shaders of shaders/llvmpipe; or 0
  uint32_t order = 8;       // shaders of `vector` keep loads in order every so many channels; 0: never
  MatrixTiles matrix = {};  // kMatrix

  bool operator==(const Conv2dKernel&) const = default;
  // Returns whether the shaders find weights by address, so that the device must have buffer addresses.
  bool needs_addresses() const {
    return algorithm == Algorithm::kPointwise || algorithm == Algorithm::kWinograd;
  }
  bool has_tile() const { return algorithm == Algorithm::kColumns || algorithm == Algorithm::kWinograd; }
  // Returns whether it computes convolutions whose kernel has this side.
  bool computes(uint32_t kernel) const {
    return kernel == 1   ? !has_tile()
           : kernel == 3 ? algorithm != Algorithm::kPointwise
                         : algorithm == Algorithm::kDirect || algorithm == Algorithm::kWinograd;
  }
  // Returns the m of F(m, 3), or 0 for other algorithms.
  uint32_t winograd_tile() const { return has_tile() ? tile : 0; }
};

// An invocation computes the products of two tiles where Conv2dKernel::vector is this.
inline constexpr uint32_t kPairedVector = 8;

// The choice of a kernel depends on these; height, width and channels are those between the shuffles.
struct Conv2dShape {
  uint32_t height, width, channels_in, channels_out, kernel;
  uint32_t most_tile = 4;               // 2 where F(4, 3) in both directions would not be accurate enough
  uint32_t unshuffle = 1, shuffle = 1;  // as in Conv2dOptions

  auto operator<=>(const Conv2dShape&) const = default;
  // Counts a multiply-add as two.
  double flop() const { return 2.0 * height * width * channels_in * channels_out * kernel * kernel; }
};
using Conv2dChoice = std::function<Conv2dKernel(const Conv2dShape&)>;

// Returns how many rows of tiles a Winograd convolution works on at a time.
uint32_t winograd_band_rows(const Conv2dShape& shape, const Conv2dKernel& how);

// Chooses the direct kernel for every shape.
inline Conv2dKernel conv2d_direct(const Conv2dShape&) { return {}; }

// Says how a graph is computed on a device; the default runs on all devices.
struct Kernels {
  bool addressed = false;  // see Graph
  uint32_t vector = 0;     // see Graph::read_vectors
  Conv2dChoice conv2d = conv2d_direct;
};

// Returns how many times as large as its direct sums the values in the transforms of a 3x3 or 5x5 convolution
// by F(4, 3) may become, with inputs of equal size: the largest over the outputs of
// |A^T| (|G g G^T| |B^T| 1 |B|) |A| over sum |g|. Rounding errors grow by as much and reach a whole tile. The
// transforms are those of kWinograd or, in one direction only, those of kColumns.
double winograd_amplification(const ConvWeights& weights, uint32_t channels_in, uint32_t kernel,
                              Algorithm algorithm);

// Returns how many input channels the 3x3 convolution has by which Winograd's kernels compute another.
inline uint32_t winograd_channels(uint32_t channels_in, uint32_t kernel) {
  return kernel == 5 ? 4 * channels_in : channels_in;
}

struct Conv2dOptions {
  uint32_t kernel = 3;  // 1, 3 or 5
  bool relu = false;
  std::vector<Tensor> residuals = {};  // three or fewer, of the output's shape; added after the activation
  std::optional<Tensor> second_input = {};  // further input channels of the input's size; not if unshuffled
  uint32_t unshuffle = 1;                   // reads `in` unshuffled by this: (r h, r w, c) -> (h, w, r r c)
  uint32_t shuffle = 1;                     // shuffles `out` by this, the inverse; channels as in PyTorch
  Conv2dKernel how = {};
};

// Convolves (h, w, in.channels) -> (h, w, out.channels) with stride 1 and zero padding. `out` may be a slice
// of the tensor that `in` is another slice of.
void conv2d(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
            const ConvWeights& weights, const Conv2dOptions& options);

// Holds the arguments of conv2d().
struct Conv2dLink {
  std::string name;
  Tensor in, out;
  ConvWeights weights;
  Conv2dOptions options;
};

// Adds one convolution after another. Each reads the output of the one before, which nothing else reads.
// Winograd convolutions that follow each other take turns, band by band, and only some rows of the tensor
// between them are in memory at a time, unless the graph is to keep() it.
void conv2d_chain(Graph& graph, std::span<const Conv2dLink> links);

// Writes the recording's exposure for the passes after it: exposure_of() the first three channels (h, w, 3)
// of the image in `slot`, in 32 bits, by sums in a fixed order. Subnormal values may count as 0.
void exposure(Graph& graph, const std::string& name, FrameSlot slot, uint32_t height, uint32_t width,
              float key);

// Says how a channel of an input image is brought into the network's range.
enum class ChannelKind : uint32_t { kRadiance, kAlbedo, kNormal, kVariance };
enum class Transfer { kLinear, kLog };

// Says where a channel comes from: a channel of the image or, already encoded, a value.
struct EncodedChannel {
  ChannelKind kind = ChannelKind::kRadiance;
  uint32_t channel = 0;
  std::optional<float> value = {};
};

// Holds the size of a frame's image that is smaller than the tensor that belongs to it. Its last row and
// column are repeated where it is read, and what lies beyond them is not written.
struct FrameSize {
  uint32_t height, width;
};

inline constexpr uint32_t kMostConstants = 8;  // channels of encode() that are values

// Encodes channels of the image in `slot`, scene linear, as (h, w, c). NaN becomes 0, and infinities
// are clamped like any value. Radiance is multiplied by the recording's exposure, variance by its
// square; both are clamped to [0, clip], then y = x or y = log(1 + 8 x) / 3. Albedo is clamped to
// [0, 1], normals to [-1, 1].
void encode(Graph& graph, const std::string& name, FrameSlot slot, const Tensor& out,
            std::span<const EncodedChannel> channels, Transfer transfer, float clip,
            const std::optional<FrameSize>& frame = {});

// Writes the variance of HRLS's color to (H, W, 3), encoded as encode() does: for each channel
// the mean over 3x3 pixels, edges replicated, of the squared difference from their mean. Values
// that are not finite count as 0.
void variance(Graph& graph, const std::string& name, const Tensor& out, Transfer transfer, float clip,
              const std::optional<FrameSize>& frame = {});

// Writes the radiance above the clip of the image in `slot`, scene linear (h, w, c): max(0, x - clip /
// exposure), at most 65504; NaN counts as 0.
void above_clip(Graph& graph, const std::string& name, FrameSlot slot, const Tensor& out, float clip);

struct DecodeOptions {
  Transfer transfer = Transfer::kLinear;
  const Tensor* base = nullptr;  // the encoded LRHS (h, w, c), upsampled and added; null: none
  uint32_t scale = 1;
  float phase = 0;  // LRHS samples in full-size pixels: 0, or (scale - 1) / 2 for a low-resolution render
  const Tensor* above_clip = nullptr;  // (h, w, c), the result of above_clip(); null: none
  float clip = 0;                      // the clip of above_clip()
  std::optional<FrameSize> frame = {};
};

// Decodes (H, W, c) into the image in kFusedSlot: adds the bilinearly upsampled base, inverts the transfer,
// divides by the recording's exposure, adds radiance above the clip, clamps to [0, 65504]. A pixel's
// radiance above the clip is the mean of the four LRHS samples around it, weighted bilinearly and each by
// itself. The share of it that is added rises from nothing where the output, still exposed, is an eighth of
// the clip to all of it at a quarter.
void decode(Graph& graph, const std::string& name, const Tensor& in, const DecodeOptions& options);

// The layers of a pyramid network filter demodulated radiance x = radiance / (albedo + 0.4) by kernels that
// the network predicts for each pixel. It is stored as ln(1 + 0.2 x) / 0.2, which is called light.

// Holds a render of every scale-th pixel, which joins light() at these pixels.
struct Decimated {
  Tensor lrhs;  // (H / scale, W / scale, 3), encoded
  uint32_t scale;
  float certainty;  // a pixel of LRHS has this, and one of HRLS has 1
};

// Writes the light of HRLS (H, W, 3). Color and albedo (H, W, 3) are encoded. Pixels that are brighter than
// 20 times their second brightest neighbour + 0.001 are darkened to that. `decimated` makes x the mean by
// certainty of both renders at the pixels that LRHS shows.
void light(Graph& graph, const std::string& name, const Tensor& color, const Tensor& albedo,
           const Tensor& out, Transfer transfer, const std::optional<Decimated>& decimated = {});

// Writes the light of LRHS (h, w, 3), whose encoded color is `lrhs`. Its albedo is that of HRLS (scale h,
// scale w, 3) at the pixel that LRHS is a sample of or, where `phase` is above 0, the mean over the pixels
// that a pixel of LRHS covers. See DecodeOptions for scale and phase.
void cell_light(Graph& graph, const std::string& name, const Tensor& lrhs, const Tensor& albedo,
                const Tensor& out, Transfer transfer, uint32_t scale, float phase);

// Holds an image that takes the place of a share of another one, 0 to 1.
struct Blend {
  Tensor other;
  float share = 0;
  std::optional<Tensor> shares = {};  // (h, w, 1), each pixel's own, in the place of `share`
};

// Counts the channels of light, albedo and normal.
inline constexpr uint32_t kPooledChannels = 9;

// Writes the means of 2 x 2 pixels of the first three channels of `in` (2 h, 2 w, C), which are light, and of
// the last six, albedo and normal, to (h, w, 9). With `blend`, whose image is (h, w, 3), the light becomes
// mean + share (other - mean).
void pool(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out,
          const std::optional<Blend>& blend = {});

// Holds what kernel_filter() may read beside the image and the logits.
struct KernelInputs {
  std::optional<Tensor> coarse = {};  // (H / 2, W / 2, 3), an image to blend with
  std::optional<Tensor> guides = {};  // (H, W, 6), albedo and normal
};

// Filters (H, W, 3) -> (H, W, 3). Each pixel becomes the mean of the side x side pixels around it, edges
// replicated, weighted by the softmax of its logits (H, W, side^2), which go row by row: Bako et al. 2017.
// `side` is odd. With `coarse` the logits have one more channel, a, and the result is
// mean + (upsampled coarse - mean) / (1 + exp(-a)). With `guides` they have two more, b and c, and lose
// 6.25 exp(b) |difference of albedo|^2 + 2.25 exp(c) |difference of normal|^2 before the softmax, where b and
// c are limited to [-6, 6]: Isik et al. 2021.
void kernel_filter(Graph& graph, const std::string& name, const Tensor& in, const Tensor& logits,
                   const Tensor& out, uint32_t side, const KernelInputs& inputs = {});

// Writes the output (H, W, 3) of a pyramid network. `rec` (H, W, 15) is a residual, the logit m of a mixture,
// and the logits of a 3x3 kernel_filter() of the albedo, guided by `guides` (H, W, 6), albedo and normal. Let
// y be x (filtered albedo + 0.4), encoded, where x is that of `light` (H, W, 3), and let b be `lrhs`
// (h, w, 3), upsampled as in DecodeOptions. The result is the residual + b + (y - b) / (1 + exp(-m)).
void compose(Graph& graph, const std::string& name, const Tensor& rec, const Tensor& light,
             const Tensor& guides, const Tensor& lrhs, const Tensor& out, Transfer transfer, uint32_t scale,
             float phase);

// These join a frame with the ones before it. A history is a buffer of the whole frame in the slots kLastSlot
// and kNextSlot, in 32 bits: planes of the first `channels` channels of HRLS, of the motion, of the depth, of
// a count of frames and of the fused image, and then, above a scale of 1, six of the size of LRHS: its color,
// deviation, change that is left, and count of frames. Radiance in it is scene linear, and the color of HRLS
// is demodulated as light() does. The image in kMotionSlot has two channels, which lead from a full-size
// pixel to the same point in the last frame, in pixels along x and y. Two more may hold the depth of that
// point in this frame and in the last one; depths that are not positive and finite say nothing.
// Program::set_place() says where the recording lies in the frame.

// Returns the planes of a history that have the size of the frame.
constexpr uint32_t history_planes(uint32_t channels) { return channels + 2 + 1 + 1 + 3; }

// Returns the floats of a history.
constexpr uint64_t history_floats(uint32_t height, uint32_t width, uint32_t channels, uint32_t scale) {
  const uint64_t lrhs = scale > 1 ? uint64_t{height / scale} * (width / scale) : 0;
  return uint64_t{height} * width * history_planes(channels) + 6 * lrhs;
}

// Writes the change of the light (h, w, 2) by LRHS (h, w, 3), encoded, and a history of its own, of up to 15
// frames: by how much the logarithm of 0.02 + luminance, the mean of 3x3 pixels, has changed since the last
// frame, and how much of that is new. Of the change d against the history max(0, 1 - e^2 / d^2) counts, where
// e is 0.01 and 1.85 standard errors of d. The variance of the noise is twice the squared mean absolute
// deviation in the last frames. It is at least that among the pixels and at most 12 times as large; among
// these it is that in the direction of four where it is least, so that an edge that moves is no noise. In a
// first frame the neighbours tell the deviation. The history also keeps what is left of the change when it
// has joined the frame. That is no noise, and the next frame's change does not hold it again. Without a
// history the change is 0.
void light_change(Graph& graph, const std::string& name, const Tensor& lrhs, const Tensor& out,
                  Transfer transfer, uint32_t scale, uint32_t channels,
                  const std::optional<FrameSize>& frame = {});

struct AccumulateOptions {
  Transfer transfer = Transfer::kLinear;
  float clip = 0;
  float spp = 1;           // samples of a pixel of this frame
  uint32_t channels = 9;   // those that are accumulated; the others are not written, but for the count
  bool has_depth = false;  // motion has depths
  std::optional<Tensor> change = {};  // (h, w, 2), the result of light_change()
  uint32_t scale = 1;                 // of `change`
  std::optional<FrameSize> frame = {};
};

// Joins encoded HRLS (H, W, K), which begins with color, albedo and normal, to its history. The first
// options.channels channels of `out` (H, W, N) get the result, and the last one the binary logarithm of the
// samples behind it, from 0 to 4. A history of n frames and this frame are n / (n + 1) and 1 / (n + 1) of the
// result. The history is read bilinearly where the motion leads. Each of its pixels counts by
// exp(-(1 - 0.95 s) (40 a + 10 b + 40 d)), where a, b and d are the squared distances of its albedo, normal
// and depth from the ranges that pixels around the pixel have: 3x3 for albedo and normal, and for depth the
// pixel and those of the four beside it whose motion is within half a pixel of its own. The distance of
// depths is that of their logarithms beyond 0.05, and 0 where one is not known. Here s = exp(-16 m) (1 -
// blur), where m is the squared distance of its motion from the pixel's, and reading blurs by 0 at a pixel
// and by 3/4 in the middle of four. The history counts for 63 frames at most. By a change c of the light its
// radiance is multiplied by exp(c), |c| <= 1, and its frames by exp(-g (8 + 20 g)), where g is the most that
// is new in the four pixels of LRHS around.
void accumulate(Graph& graph, const std::string& name, const Tensor& hrls, const Tensor& out,
                const AccumulateOptions& options);

struct SettleOptions {
  Transfer transfer = Transfer::kLinear;
  float clip = 0;
  float spp = 1;          // samples of a pixel of this frame
  uint32_t channels = 9;  // those of HRLS that the history has
  std::optional<FrameSize> frame = {};
};

// Mixes the encoded fused image (H, W, 3) with that of the last frame and keeps it, as it was, for the next.
// The last one is read bilinearly where the motion leads and clamped to the range of the 3x3 pixels. Its
// share is 0.6 (1 - 0.8 b) max(0, 1 - 1.01 spp / n). Here `samples` (H, W, 1) has the binary logarithm of
// the n samples that accumulate() counted, and b is how much reading blurs: 0 at a pixel, 3/4 in the middle
// of four. The share is 0 where the motion leads out of the frame.
void settle(Graph& graph, const std::string& name, const Tensor& fused, const Tensor& samples,
            const Tensor& out, const SettleOptions& options);

// Writes the variance (H, W, 3) of an encoded color (H, W, 3), as variance() does.
void color_variance(Graph& graph, const std::string& name, const Tensor& color, const Tensor& out,
                    Transfer transfer, float clip, const std::optional<FrameSize>& frame = {});

// Writes the share (h, w, 1) of LRHS in the light of its level: certainty / (certainty + scale^2 n), where n
// is the mean of the samples of HRLS in a cell, of which `samples` (scale h, scale w, 1) has binary
// logarithms.
void cell_share(Graph& graph, const std::string& name, const Tensor& samples, const Tensor& out,
                uint32_t scale, float certainty);

// These prepare the inputs of KPCN (Bako et al. 2017), and make its output.

// Writes the differences to the next pixel along x, and then along y: (H, W, C) -> (H, W, 2 C). They are 0 in
// the last column and the last row.
void gradients(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out);

// Writes max(0, whole - part) (H, W, C), both decoded, encoded again.
void remainder(Graph& graph, const std::string& name, const Tensor& whole, const Tensor& part,
               const Tensor& out, Transfer transfer);

// Multiplies filtered demodulated radiance (H, W, 3) by albedo + 0.4, adds the encoded rest of the radiance,
// and encodes the result.
void remodulate(Graph& graph, const std::string& name, const Tensor& demodulated, const Tensor& albedo,
                const Tensor& rest, const Tensor& out, Transfer transfer);

// These are channel attention (Zhang et al. 2018), which has two 1x1 convolutions of (1, 1, C) between them.

// Writes the mean of each channel, (h, w, C) -> (1, 1, C), summed in a fixed order, so that it has the same
// bits however a dispatch is split. Both have the same exponent.
void channel_means(Graph& graph, const std::string& name, const Tensor& in, const Tensor& out);

// Writes in / (1 + exp(-logit)) + residual (h, w, C), with a logit for each channel (1, 1, C). All but the
// logits have the same exponent, and these have none.
void attend(Graph& graph, const std::string& name, const Tensor& in, const Tensor& logits,
            const Tensor& residual, const Tensor& out);

}  // namespace raymeld
