#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "layers/layers.h"

namespace raymeld {

struct SafeTensors;

// Chooses the tensor that is added to the trunk's output: F_LRHS (section 4 and figure 4 of Hou et al. 2021)
// or F_0 (their Eq. 8).
enum class LongSkip { kLrhs, kFused };

// Chooses how HRLS is brought to LRHS size: convolved at full size and halved step by step (their Eq. 5 and
// 6), or unshuffled at once.
enum class HrlsEncoder { kFull, kUnshuffled };

// Chooses how features are brought to full size: doubled step by step (their Eq. 9), or at once.
enum class Upscale { kStages, kDirect };

// Lists the networks: that of Hou et al. 2021, a U-Net that predicts kernels, EDSR (Lim et al. 2017),
// RCAN (Zhang et al. 2018) and KPCN (Bako et al. 2017).
enum class NetworkKind { kFusion, kPyramid, kEdsr, kRcan, kKpcn };
inline constexpr NetworkKind kNetworkKinds[] = {NetworkKind::kFusion, NetworkKind::kPyramid,
                                                NetworkKind::kEdsr, NetworkKind::kRcan, NetworkKind::kKpcn};

// Holds the parameters of a network, all of them from the model's file. The letters are those of the paper.
struct Architecture {
  NetworkKind kind = NetworkKind::kFusion;
  uint32_t scale = 0;                        // s: 1, 2, 4 or 8; with 1 only HRLS is read
  uint32_t features = 0;                     // C
  uint32_t growth = 0;                       // R
  uint32_t dense_layers = 0;                 // D, in each block
  uint32_t blocks = 0;                       // B, in each group
  uint32_t groups = 0;                       // G
  uint32_t squeezed_features = 0;            // S, channels inside of RCAN's attention
  uint32_t depth = 0;                        // convolutions of each branch of KPCN
  uint32_t kernel_side = 0;                  // the side of the kernels that KPCN predicts
  std::vector<std::string> hrls_layers;      // three channels each, color first
  std::vector<std::string> optional_layers;  // layers that a render may lack, read as zeros
  LongSkip long_skip = LongSkip::kLrhs;
  bool merge_relu = false;  // a ReLU after a block's 1x1
  HrlsEncoder hrls_encoder = HrlsEncoder::kFull;
  uint32_t hrls_kernel = 3;  // 1 or 3, for the convolution of unshuffled HRLS
  Upscale upscale = Upscale::kStages;
  uint32_t upscaled_features = 0;  // M
  bool hrls_guide = false;         // the encoded HRLS is read again beside the upscaled features
  uint32_t head_features = 0;      // H, output channels of the convolutions before the last one
  uint32_t head_layers = 0;        // N of these convolutions; each but the first adds to its input
  Transfer transfer = Transfer::kLinear;
  float exposure_key = 0;  // the key of exposure_of(); 0: inputs are read unscaled
  float clip = 0;          // the largest radiance, scene linear
  // LRHS samples lie by default in the centre of their s x s full-size pixels, not in the top-left one.
  bool lrhs_centered = false;
  bool both_samplings = false;  // trained on both, with a separate bias for centered samples
  bool has_base = false;        // the output is added to the bilinearly upsampled LRHS
  float lrhs_certainty = 0;     // a pyramid's certainty of a pixel of LRHS; see docs/model-format.md
  bool knows_spp = false;       // biases and certainty depend on SampleCounts
  // Has the features of a pyramid's levels, of half the full size and so on; it is empty for other networks.
  // C, R, D, B, G, the heads and the base are fields of the network of Hou et al. 2021. Of these EDSR has C
  // and B, RCAN has C, B and G, and KPCN has C.
  std::vector<uint32_t> widths;

  bool is_pyramid() const { return kind == NetworkKind::kPyramid; }
  bool reads_lrhs() const { return scale > 1; }
  bool reads_hrls() const { return kind != NetworkKind::kEdsr && kind != NetworkKind::kRcan; }
  // Returns the slot of the image that sets the exposure, and whose radiance above the clip is added. It is
  // LRHS or HRLS, which begins with its color.
  FrameSlot bright_slot() const { return reads_lrhs() ? kLrhsSlot : kHrlsSlot; }
  // Returns the LRHS pixels in each direction of a pixel of the coarsest level; tiles start at multiples.
  uint32_t grid() const { return is_pyramid() ? (1u << widths.size()) / scale : 1; }
  // Returns the features of the convolution that reads LRHS.
  uint32_t lrhs_features() const { return is_pyramid() ? widths[levels() - 1] : features; }

  uint32_t levels() const;  // log2(scale)
  bool trained_on(bool centered) const { return both_samplings || centered == lrhs_centered; }
};

// Says how many samples a pixel of each render has; 0 where that is not known. Unknown counts are taken for
// s^2 and 1: a pixel of LRHS has as many samples as the s x s pixels of HRLS that it covers.
struct SampleCounts {
  float lrhs = 0, hrls = 0;

  bool operator==(const SampleCounts&) const = default;
  // Returns the counts, each known and within what networks were trained on: 1 to 256 and 1 to 16.
  SampleCounts known(uint32_t scale) const;
};

// Returns the kind of a layer's three channels.
ChannelKind kind_of(std::string_view layer);

// Holds a network with its weights. It is immutable once loaded, and must outlive every Fuser made from it.
class Model {
 public:
  // Reads a safetensors file, and checks that its tensors are exactly those that its metadata implies and
  // that all values are finite. Throws an Error that names the file, the tensor or the metadata entry, and
  // what was expected.
  explicit Model(const std::filesystem::path& file);
  // Does the same with the content of such a file, which messages call `file`.
  Model(SafeTensors content, const std::string& file);

  const Architecture& architecture() const { return architecture_; }
  const std::string& name() const { return name_; }
  const std::string& file() const { return file_; }
  const std::map<std::string, std::string>& metadata() const { return metadata_; }
  uint64_t parameters() const;
  float largest_weight() const;  // the largest magnitude, without biases

  // Returns the part of layer `name`'s bias that grows with the logarithm of a sample count, [out].
  std::span<const float> bias_by_spp(const std::string& name, uint32_t out) const {
    return tensor(name + ".by_spp", {out});
  }
  // Returns the weights of layer `name`, whose shape must be [out][in][kernel][kernel]. `bias` names one of
  // its biases.
  ConvWeights conv(const std::string& name, uint32_t out, uint32_t in, uint32_t kernel,
                   const std::string& bias = "bias") const;
  // Returns the weights of the layer `hrls` of a pyramid network that knows_spp, whose input has the binary
  // logarithm of the samples of each of 2 x 2 pixels as its last four channels, in the place of a sample
  // count of all.
  ConvWeights conv_by_pixel() const;

 private:
  struct Values {
    std::vector<size_t> shape;
    std::vector<float> values;
  };
  std::span<const float> tensor(const std::string& name, const std::vector<size_t>& shape) const;
  void check_tensors() const;
  void weigh_samples();

  std::string file_;
  std::string name_;
  Architecture architecture_;
  std::map<std::string, std::string> metadata_;
  std::map<std::string, Values> tensors_;
  std::vector<float> by_pixel_;  // the weights of conv_by_pixel(), or empty
};

// Reads the metadata of a model's file. Throws an Error that names the file, the entry and the values that it
// may have.
Architecture parse_architecture(const std::map<std::string, std::string>& metadata, const std::string& file);

}  // namespace raymeld
