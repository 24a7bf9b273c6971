#pragma once

#include <map>
#include <string>
#include <vector>

#include "reference/bounds.h"

// The scalar truth: every layer as its equation, in double, with the bound that any right device keeps
// (fp32 accumulation in any order, fp32 or fp16 storage). Shares nothing with the engine. Weights and input
// images are what the device reads: the caller rounds them to the storage type (round_to).
namespace raymeld::reference {

// A convolution's weights [out][in][kernel][kernel] and bias [out]; the kernel is 1 or 3. centered_bias: what
// the network reads instead of the bias where LRHS samples lie centered; empty where it makes no difference.
struct Conv {
  int out = 0, in = 0, kernel = 0;
  std::vector<double> weight, bias, centered_bias = {};

  double at(int o, int i, int ky, int kx) const {
    return weight[((size_t(o) * in + i) * kernel + ky) * kernel + kx];
  }
};

// (in, h, w) -> (out, h, w), stride 1, zero padding: sum + bias, then ReLU if asked, then + residuals in
// turn. ReLU turns what is below 0 into 0 and keeps NaN and, as
// a sign of overflow, -infinity.
// The bound is that of a direct sum or, with `tile` m > 1 and a 3x3 kernel, of minimal filtering F(m, 3):
// each output's magnitude S is then what flows through the absolute values of the transforms, from its whole
// tile. `units`: what one operation errs by, in units of a rounding to nearest; kMatrixUnits on tensor cores.
Bounded conv2d(const Bounded& x, const Conv& conv, bool relu, Precision precision,
               const std::vector<const Bounded*>& residuals = {}, int tile = 0, int units = 1);

// What one right device makes of it: sums in floats, in the order of the equation or, with `tile`, of F(m,
// 3), and stored.
Planes conv2d_in_floats(const Planes& x, const Conv& conv, bool relu, Precision precision,
                        const std::vector<const Planes*>& residuals = {}, int tile = 0);

// A tensor core's step adds b exact products to a sum: it may align these b + 1 addends to the largest, of
// which it keeps 24 bits, and truncate each and their sum, so that every one of b + 2 truncations errs by
// less than 2 u S. n products take n / b steps: 2 (1 + 2 / b) n u S, which is at most 4 n u S as no step has
// b < 2.
inline constexpr int kMatrixUnits = 4;

// Along c.
Planes concat(Planes a, const Planes& b);
Bounded concat(const Bounded& a, const Bounded& b);
// Channels.
Bounded slice(const Bounded& x, int first, int count);

// (c, r*h, r*w) -> (r*r*c, h, w) and back: channel c*r*r + r*dy + dx, as PyTorch's pixel_unshuffle and
// pixel_shuffle.
Bounded space_to_depth(const Bounded& x, int r);
Bounded pixel_shuffle(const Bounded& x, int r);

// The exposure of LRHS (3, h, w) and its inverse, (2, 1, 1): key / m^2, where m is the mean of the square
// root of luminance (Rec. 709) of colors in [0, 65504], NaN as 0; from 2^-24 to 2^24, and 1 where all is
// black. The bound is that of sums in fp32 of 2^14 runs of pixels and by two trees of 128 leaves.
Bounded exposure(const Planes& lrhs, double key);

enum class LayerKind { kRadiance, kAlbedo, kNormal, kVariance };
enum class Transfer { kLinear, kLog };

// One image layer as the network reads it: NaN -> 0; radiance times `exposure` (a float), variance times its
// square, clamped to [0, clip] and transferred (linear x, log ln(1 + 8x) / 3), albedo clamped to [0, 1],
// normal to [-1, 1].
Bounded encode(const Planes& image, LayerKind kind, Transfer transfer, double clip, Precision precision,
               double exposure = 1);

// For each channel the mean over 3x3 pixels, edges replicated, of the squared difference from their mean,
// encoded as LayerKind::kVariance; what is not finite counts as 0.
Bounded variance(const Planes& color, Transfer transfer, double clip, Precision precision,
                 double exposure = 1);

// (c, h, w) -> (c, s*h, s*w): output X reads u = (X - phase) / s clamped to [0, w - 1], likewise y. Unstored.
Bounded bilinear(const Bounded& x, int scale, double phase);

// max(0, x - clip / exposure), at most 65504; of NaN 0.
Bounded above_clip(const Planes& image, double clip, Precision precision, double exposure = 1);

// (c, h, w) -> (c, s*h, s*w): as bilinear(), but with factors that are multiplied by the values; 0 of zeros.
// Unstored.
Bounded self_weighted(const Bounded& x, int scale, double phase);

// y = rec (+ base), then v: linear y or log (exp(3y) - 1) / 8, then v over `exposure`, plus highlights times
// 8 v / clip - 1 clamped to [0, 1], clamped to [0, 65504]. base and highlights may be null.
Bounded decode(const Bounded& rec, const Bounded* base, Transfer transfer, Precision precision,
               double exposure = 1, const Bounded* above_clip = nullptr, double clip = 0);

// The layers of the joint base, on encoded images: (h, w) is the LRHS size, (H, W) = scale * (h, w).

// LRHS color (3, h, w) over HRLS albedo (3, H, W) + 0.4, encoded, and of that the mean of 3x3 pixels, edges
// replicated, weighted by (1/4, 1/2, 1/4)^2 and by exp(-d^2), d being the distance of albedo / 1.5 and normal
// / 1.2. Albedo and normal: of the top-left pixel of the cell, or, where phase > 0, the mean over the cell.
Bounded irradiance(const Bounded& lrhs, const Bounded& albedo, const Bounded& normal, Transfer transfer,
                   int scale, double phase, Precision precision);

// (5, H, W): log(1 + 0.2 x) / 0.2, its certainty, and the Rec. 709 luminance of the upsampled irradiance. x:
// light is color / (albedo + 0.4); that of HRLS, its luminance limited to 20 times that of the second
// brightest of eight neighbours (black outside) + 0.001, counts 1, that of LRHS (6, h, w: color and
// irradiance) counts `certainty` at top-left pixels of cells, or, where phase > 0, certainty / scale^2
// everywhere, where it is the upsampled irradiance.
Bounded demodulate(const Bounded& color, const Bounded& albedo, const Bounded& lrhs, double certainty,
                   Transfer transfer, int scale, double phase, Precision precision);

// (4, H, W) of the same: the mean of the 3x3 pixels at distances of `step`, edges replicated, weighted by
// (1/4, 1/2, 1/4)^2 and by exp(-d^2), d being the distance of albedo / 1.5, normal / 1.2 and, of one channel,
// brightness / 0.0667. The last channel weights the others as well.
Bounded joint_filter(const Bounded& x, const Bounded& albedo, const Bounded& normal,
                     const Bounded& brightness, int step, Precision precision);

// The encoded image (3, H, W) that light (3, H, W) makes of the albedo.
Bounded remodulate(const Bounded& light, const Bounded& albedo, Transfer transfer, Precision precision);

// rec (8, H, W): a residual, added to the mean of five candidates, weighted by the softmax of five logits:
// LRHS (6, h, w: color and irradiance) upsampled, its irradiance upsampled and relit, `candidates` (9, H, W).
Bounded mix(const Bounded& rec, const Bounded& lrhs, const Bounded& albedo, const Bounded& candidates,
            Transfer transfer, int scale, double phase, Precision precision);

enum class Base { kNone, kBilinear, kJoint };

// What the model file's metadata says.
struct Architecture {
  int scale = 0, features = 0, growth = 0, dense_layers = 0, blocks = 0, groups = 0;
  std::vector<LayerKind> hrls_layers = {};  // 3 channels each, in the order of the HRLS input
  bool long_skip_fused = false, merge_relu = false;
  Base base = Base::kNone;
  Transfer transfer = Transfer::kLinear;
  double clip = 0;
  bool hrls_unshuffled = false, upscale_direct = false, hrls_guide = false, both_samplings = false;
  int upscaled_features = 0, head_features = 0, head_layers = 0;  // upscaled_features 0: as many as features
  double lrhs_certainty = 0;                                      // of the joint base
  int hrls_kernel = 3;                                            // of what is unshuffled

  int upscaled() const { return upscaled_features > 0 ? upscaled_features : features; }
  // Channels that the network reads and writes.
  int lrhs_channels() const { return base == Base::kJoint ? 6 : 3; }
  int hrls_channels() const { return 3 * int(hrls_layers.size()) + (base == Base::kJoint ? 9 : 0); }
  int rec_channels() const { return base == Base::kJoint ? 8 : 3; }
};

using Weights = std::map<std::string, Conv>;     // by the layer's name: "groups.0.blocks.1.merge"
using Outputs = std::map<std::string, Bounded>;  // by the same, and those that network() names

// Every layer's output by the name of its weights: `merge` with the block's input added, `up.i` after the
// shuffle. Further encode.lrhs, encode.hrls; highlights (3, h, w), scene linear and not exposed; groups.0 and
// so on, the last merge with the group's input added too; trunk, the last of these with the long skip; output
// (3, s*h, s*w), which is fp32. With the joint base also irradiance, light, joint.0 to joint.4, relight.1,
// relight.3, relight.5 and mix. phase > 0 is centered. lrhs (3, h, w) and hrls (3 * layers, s*h, s*w) are raw
// images. Layers named in `given` are computed and then replaced by the given values as exact: with a
// device's own outputs each layer is checked against what the device itself fed it, and bounds do not pile
// up. `tile`, of the 3x3 convolutions, and `units`: see conv2d().
Outputs network(const Architecture& architecture, const Weights& weights, const Planes& lrhs,
                const Planes& hrls, double phase, Precision precision,
                const std::map<std::string, Planes>& given = {}, double exposure = 1, int tile = 0,
                int units = 1);

// What one right device makes of the same, by the same names: each convolution by conv2d_in_floats(), and of
// any other layer values drawn evenly from within the layer's own bounds. How far these are from the truth is
// how far a device may be expected to be, where the bounds of network() say how far the worst may.
std::map<std::string, Planes> network_in_floats(const Architecture& architecture, const Weights& weights,
                                                const Planes& lrhs, const Planes& hrls, double phase,
                                                Precision precision, double exposure = 1, int tile = 0);

}  // namespace raymeld::reference
