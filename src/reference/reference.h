#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "reference/bounds.h"

// Computes every layer as its equation, in double, with the bound that any right device keeps (fp32
// accumulation in any order, fp32 or fp16 storage). It shares no code with the engine. The caller rounds
// weights and input images to the storage type (round_to()), because the device reads them so.
namespace raymeld::reference {

// Holds a convolution's weights [out][in][kernel][kernel] and bias [out]; the kernel is 1, 3 or 5. The
// network reads centered_bias instead of the bias where LRHS samples lie centered, unless it is empty. by_spp
// is the part of the bias that grows with the binary logarithm of a sample count, or empty.
struct Conv {
  int out = 0, in = 0, kernel = 0;
  std::vector<double> weight, bias, centered_bias = {}, by_spp = {};

  double at(int o, int i, int ky, int kx) const {
    return weight[((size_t(o) * in + i) * kernel + ky) * kernel + kx];
  }
};

// Says in what tiles a 3x3 convolution is computed: by Winograd's F(m, 3) down columns and across rows, with
// these m, where 1 stands for direct sums.
struct Tile {
  int down = 1, across = 1;

  auto operator<=>(const Tile&) const = default;
};

// Computes (in, h, w) -> (out, h, w) with stride 1 and zero padding: sum + bias, then ReLU if asked, then
// + residuals in turn. ReLU turns negative values into 0. It keeps NaN and, as a sign of overflow, -infinity.
//
// The bound is that of a direct sum. With a tile of several pixels and a 3x3 kernel it is that of Winograd's
// F(m, 3): each output's magnitude S comes from its whole tile, see winograd_magnitudes(). `units` is the
// largest error of an operation, in errors of a rounding to nearest: kTensorUnits on tensor cores and in dot
// products.
Bounded conv2d(const Bounded& x, const Conv& conv, bool relu, Precision precision,
               const std::vector<const Bounded*>& residuals = {}, const Tile& tile = {}, int units = 1);

// Does the same as one right device would: it sums in floats, in the order of the equation or, by tiles,
// of F(m, 3), and rounds the results to the storage type.
Planes conv2d_in_floats(const Planes& x, const Conv& conv, bool relu, Precision precision,
                        const std::vector<const Planes*>& residuals = {}, const Tile& tile = {});

// A step of a tensor core, or a dot product, adds b exact products to a sum. It may align these b + 1 addends
// to the largest one, keep 24 bits of that, and truncate each addend and their sum. Each of these b + 2
// truncations errs by less than 2 u S. The n / b steps of n products err by 2 (1 + 2 / b) n u S, which is at
// most 4 n u S as no step has b < 2.
inline constexpr int kTensorUnits = 4;

// Concatenates channels.
Planes concat(Planes a, const Planes& b);
Bounded concat(const Bounded& a, const Bounded& b);
// Returns `count` channels from `first` on.
Bounded slice(const Bounded& x, int first, int count);

// These map (c, r*h, r*w) to (r*r*c, h, w) and back as PyTorch's pixel_unshuffle and pixel_shuffle do, with
// channel c*r*r + r*dy + dx.
Bounded space_to_depth(const Bounded& x, int r);
Bounded pixel_shuffle(const Bounded& x, int r);

// Returns the exposure of LRHS (3, h, w) and its inverse, as (2, 1, 1). It is key / m^2 clamped to [2^-24,
// 2^24], where m is the mean of the square root of luminance (Rec. 709) of colors clamped to [0, 65504], NaN
// counting as 0. A black image has the exposure 1. The bound is that of fp32 sums, of 2^14 runs of pixels and
// then by two trees of 128 leaves.
Bounded exposure(const Planes& lrhs, double key);

enum class LayerKind { kRadiance, kAlbedo, kNormal, kVariance };
enum class Transfer { kLinear, kLog };

// Encodes one image layer as the network reads it. NaN becomes 0. Radiance is multiplied by `exposure` (a
// float) and variance by its square, then both are clamped to [0, clip] and transferred (linear x, log ln(1 +
// 8x) / 3). Albedo is clamped to [0, 1] and normals to [-1, 1].
Bounded encode(const Planes& image, LayerKind kind, Transfer transfer, double clip, Precision precision,
               double exposure = 1);

// Returns for each channel the mean over 3x3 pixels, edges replicated, of the squared difference from their
// mean, encoded as LayerKind::kVariance. Values that are not finite count as 0.
Bounded variance(const Planes& color, Transfer transfer, double clip, Precision precision,
                 double exposure = 1);

// Upsamples (c, h, w) to (c, s*h, s*w): column X reads u = (X - phase) / s clamped to [0, w - 1], and rows do
// likewise. The result is not rounded to a storage type.
Bounded bilinear(const Bounded& x, int scale, double phase);

// Returns max(0, x - clip / exposure), at most 65504, and 0 for NaN.
Bounded above_clip(const Planes& image, double clip, Precision precision, double exposure = 1);

// Upsamples as bilinear() does, but weights each sample by its factor times its value. The mean of zeros is
// 0. The result is not rounded to a storage type.
Bounded self_weighted(const Bounded& x, int scale, double phase);

// Decodes y = rec (+ base). Let v be y with the linear transfer and (exp(3y) - 1) / 8 with the log one. The
// result is v / exposure + above_clip * (8 v / clip - 1 clamped to [0, 1]), clamped to [0, 65504]. `base` and
// `above_clip` have the size of `rec`, or are null.
Bounded decode(const Bounded& rec, const Bounded* base, Transfer transfer, Precision precision,
               double exposure = 1, const Bounded* above_clip = nullptr, double clip = 0);

// The layers of a pyramid network: light is ln(1 + 0.2 x) / 0.2 of x = radiance / (albedo + 0.4).

// Holds a render of every scale-th pixel, which joins light() at these pixels.
struct Decimated {
  const Bounded& lrhs;  // (3, H / scale, W / scale), encoded
  int scale;
  double certainty;  // a pixel of LRHS has this, and one of HRLS has 1
};

// Returns the light of encoded color (3, H, W). The luminance of a pixel is limited to 20 times that of the
// second brightest of its eight neighbours (black outside) + 0.001. `decimated` makes x the mean by certainty
// of both renders at the top left pixel of each cell.
Bounded light(const Bounded& color, const Bounded& albedo, Transfer transfer, Precision precision,
              const std::optional<Decimated>& decimated = {});

// Returns the light of LRHS (3, h, w). Its albedo is that of HRLS at the top left pixel of each cell or,
// where phase > 0, the mean over the cell.
Bounded cell_light(const Bounded& lrhs, const Bounded& albedo, Transfer transfer, int scale, double phase,
                   Precision precision);

// Returns the means (9, h, w) of 2 x 2 pixels of the first three channels of x (c, 2 h, 2 w), light, and of
// the last six. Those of the light are moved to `other` (3, h, w) by `share` if other is not null. `shares`
// (1, h, w) give each pixel its own.
Bounded pool(const Bounded& x, Precision precision, const Bounded* other = nullptr, double share = 0,
             const Bounded* shares = nullptr);

// Returns for each pixel of x (3, H, W) the mean over side x side pixels, edges replicated, weighted by the
// softmax of its logits (side^2, H, W). With `coarse` (3, H / 2, W / 2) there is one more logit a, and the
// result is mean + (upsampled coarse - mean) / (1 + exp(-a)). With `guides` (6, H, W), albedo and normal,
// there are two more, b and c, limited to [-6, 6]: 6.25 exp(b) |difference of albedo|^2 + 2.25 exp(c)
// |difference of normal|^2 is taken from the logits.
Bounded kernel_filter(const Bounded& x, const Bounded& logits, int side, Precision precision,
                      const Bounded* coarse = nullptr, const Bounded* guides = nullptr);

// Returns residual + b + (y - b) / (1 + exp(-m)): rec (15, H, W) is the residual, m and the logits of a 3x3
// filter of the albedo that guides (6, H, W) guide, y is encoded x (filtered albedo + 0.4) with the x of
// `light` (3, H, W), and b is upsampled lrhs (3, h, w).
Bounded compose(const Bounded& rec, const Bounded& light, const Bounded& guides, const Bounded& lrhs,
                Transfer transfer, int scale, double phase, Precision precision);

// These are KPCN's.

// Returns (2c, h, w): the differences to the next pixel along x, and then along y, 0 in the last column and
// row.
Bounded gradients(const Bounded& x, Precision precision);

// Returns max(0, whole - part), both decoded, encoded again.
Bounded remainder(const Bounded& whole, const Bounded& part, Transfer transfer, Precision precision);

// Takes ln(1 + 0.2 x) / 0.2 of demodulated radiance x (3, H, W) and returns x * (albedo + 0.4) plus the
// decoded rest of the radiance, encoded.
Bounded remodulate(const Bounded& demodulated, const Bounded& albedo, const Bounded& rest, Transfer transfer,
                   Precision precision);

// The layers of channel attention follow.

// Returns (c, 1, 1), the mean of each channel. The bound is that of fp32 sums of 128 runs of pixels and then
// by a tree.
Bounded channel_means(const Bounded& x, Precision precision);

// Returns x / (1 + exp(-logit)) + residual, with the logits (c, 1, 1) limited to [-80, 80].
Bounded attend(const Bounded& x, const Bounded& logits, const Bounded& residual, Precision precision);

// The layers that join a frame with the ones before it follow.

// Holds what they read beside the frame.
struct Past {
  // (2, H, W), from each full-size pixel to the same point in the last frame. Its depths in this frame and in
  // the last one may follow.
  const Planes& motion;
  // The last history (A + 4, frame height, frame width), whose last planes are motion, depth and a count.
  const Planes& hrls;
  // (6, frame height / scale, frame width / scale): color, deviation, the change that is left, and a count.
  const Planes& lrhs;
  const Planes& fused;  // (3, frame height, frame width), the last fused image, scene linear
  int y, x;             // the first full-size pixel of this part of the frame
  double exposure;
};

// Returns (8, h, w): the change of the light since the last frame, how much of it is new, and then the
// history of LRHS that is kept. The change is g d - a, where d is the difference of the logarithms of 0.02 +
// luminance now and in the history, means over the n of the 3x3 pixels that are known, a is what was left in
// the last frame, and g = max(1 - (e + 0.01)^2 / d^2, min(max(a / d, 0), 1)). Here e is 1.85 sqrt(v / n) /
// (0.02 + l) with the smaller luminance l, and v is twice the mean squared deviation in the history, but at
// least the variance among the pixels, in that of four directions where it is least, and at most 12 times
// that. What of g d goes beyond a is new. Where fewer than two pixels are known, g d is a. What is left for
// the next frame is g times the difference of the logarithms now and in the history that has joined the
// frame, of 15 frames at most before. The deviation that is kept is the mean over the frames of the distance
// of the pixel's own change from that of the 3x3 pixels. A distance counts up to twice the mean and 0.002
// over the frames but one. In a first frame the deviation is the root of twice such a variance of the
// luminance.
Bounded light_change(const Bounded& lrhs, const Past& past, Transfer transfer, int scale,
                     Precision precision);

// Returns (2 A + 5, H, W): the first A channels of HRLS joined with the history, encoded, and the binary
// logarithm of their samples, within 0 and 4, and then the history that is kept. The first channels are
// color, albedo and normal, all others radiance; the history has demodulated radiance in the place of the
// color. A pixel of the history counts by exp(-(1 - 0.95 s) (40 a + 10 b + 40 d)), where a, b and d are the
// squared distances of its albedo, normal and depth from the ranges of pixels of HRLS around: of 3x3 for
// albedo and normal, and for depth of the pixel and those of the four beside it whose motion is within half a
// pixel of its own. The distance of depths is that of logarithms beyond 0.05, and 0 where one is not known.
// Here s = exp(-16 m) (1 - blur), with the squared distance m of its motion from the pixel's; settle() says
// what blurs. Together the four pixels around a point count for 63 frames at most. Their radiance is
// multiplied by exp(c), where c is interpolated from the first channel of `change` (2, H / scale, W / scale)
// and clamped to
// [-1, 1], and their frames by exp(-g (8 + 20 g)), where g is the largest value of the second channel around.
Bounded accumulate(const Bounded& hrls, const Past& past, Transfer transfer, double clip, double spp,
                   Precision precision, const Bounded* change = nullptr, int scale = 1);

// Returns (6, H, W): the encoded fused image (3, H, W) mixed with the last one, and then that which is kept.
// The last one is encoded, clamped to the range of the 3x3 pixels, and has the share
// 0.6 (1 - 0.8 b) max(0, 1 - 1.01 spp / n), with the binary logarithm of n in `samples` (1, H, W), and the
// blur b as 1 minus the sum of the squares of the weights that it is read with.
Bounded settle(const Bounded& fused, const Bounded& samples, const Past& past, Transfer transfer, double clip,
               double spp, Precision precision);

// Returns the variance of an encoded color (3, H, W), as variance() does.
Bounded color_variance(const Bounded& color, Transfer transfer, double clip, Precision precision);

// Returns certainty / (certainty + the sum of the samples in each cell), which are given by their logarithms.
Bounded cell_share(const Bounded& samples, int scale, double certainty, Precision precision);

enum class Upscale { kStages, kDirect };
enum class Upscaler { kNone, kEdsr, kRcan };

// Holds the architecture that a model file's metadata describe.
struct Architecture {
  // EDSR and RCAN read LRHS alone, and have features, blocks, transfer and clip; RCAN has groups as well.
  Upscaler upscaler = Upscaler::kNone;
  int scale = 0, features = 0, growth = 0, dense_layers = 0, blocks = 0, groups = 0;
  std::vector<LayerKind> hrls_layers = {};  // 3 channels each, in the order of the HRLS input
  bool long_skip_fused = false, merge_relu = false;
  bool has_base = false;  // the output is added to the upsampled LRHS
  Transfer transfer = Transfer::kLinear;
  double clip = 0;
  bool hrls_unshuffled = false, hrls_guide = false, both_samplings = false;
  Upscale upscale = Upscale::kStages;
  int upscaled_features = 0, head_features = 0, head_layers = 0;  // upscaled_features 0: as many as features
  double lrhs_certainty = 0;                                      // a pyramid's certainty of LRHS
  int hrls_kernel = 3;                                            // the kernel of unshuffled HRLS
  bool knows_spp = false;                                         // see take_samples()
  // Holds the features of a pyramid network's four levels, or nothing for the network of the paper. Of the
  // entries above it has those of the layers, transfer, clip, samplings, samples and upscaled_features.
  std::vector<int> widths = {};
  int squeezed_features = 0;  // channels inside of RCAN's attention
  // These are KPCN's: the convolutions of a branch, 0 for other networks, and the side of its kernels. Its
  // HRLS begins with color, albedo, normal and diffuse. It has features, transfer and clip.
  int depth = 0, kernel_side = 0;

  bool is_pyramid() const { return !widths.empty(); }
  bool is_kpcn() const { return depth > 0; }
  // Returns the LRHS pixels in each direction of a pixel of the coarsest level.
  int grid() const { return is_pyramid() ? (1 << widths.size()) / scale : 1; }
  int upscaled() const { return upscaled_features > 0 ? upscaled_features : features; }
};

using Weights = std::map<std::string, Conv>;     // keys are names of layers: "groups.0.blocks.1.merge"
using Outputs = std::map<std::string, Bounded>;  // keys are these and those that network() adds

// Turns a network that knows_spp into the one that it is for these samples a pixel: lrhs and hrls have other
// biases, and lrhs_certainty is multiplied by lrhs_spp / (hrls_spp s^2).
void take_samples(Architecture& architecture, Weights& weights, double lrhs_spp, double hrls_spp);

// Returns every layer's output by the name of its weights: `merge` with the block's input added, `up.i` after
// the shuffle. Further outputs are encode.lrhs, encode.hrls, above_clip (3, h, w; scene linear and not
// exposed), groups.0 and so on (the last merge with the group's input added too), trunk (the last of these
// with the long skip) and output (3, s*h, s*w; in fp32).
//
// A pyramid network adds light, cell_light, pool.i, filter.i and compose. All its outputs but
// above_clip and output are of the padded size, whose sides are multiples of grid() LRHS pixels: the last row
// and column are repeated.
//
// KPCN adds light, remainder, gradients, filter.diffuse, filter.rest and remodulate.
//
// RCAN adds NAME.means and NAME.attend for each block, which is NAME.
//
// `lrhs` (3, h, w) and `hrls` (3 * layers, s*h, s*w) are raw images, and phase > 0 is centered. A network of
// scale 1, which is a pyramid, takes the color of `hrls` as `lrhs`, and has neither encode.lrhs nor
// cell_light. Layers named in `given` are computed, and then later layers read the given values as exact.
// Each layer is thus checked for the inputs that it had on a device, if `given` has the device's outputs, and
// bounds do not pile up. See conv2d() for `units`, and for `tile`, which applies to 3x3 convolutions.
Outputs network(const Architecture& architecture, const Weights& weights, const Planes& lrhs,
                const Planes& hrls, double phase, Precision precision,
                const std::map<std::string, Planes>& given = {}, double exposure = 1, const Tile& tile = {},
                int units = 1);

// Returns outputs that one right device might have, by the same names: conv2d_in_floats() computes
// convolutions, and the values of other layers are drawn evenly from within the layer's own bounds. Their
// errors are as large as those that a device may be expected to have, while the bounds of network() are those
// of the worst device.
std::map<std::string, Planes> network_in_floats(const Architecture& architecture, const Weights& weights,
                                                const Planes& lrhs, const Planes& hrls, double phase,
                                                Precision precision, double exposure = 1,
                                                const Tile& tile = {});

}  // namespace raymeld::reference
