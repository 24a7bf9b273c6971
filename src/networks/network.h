#pragma once

#include "networks/activations.h"
#include "networks/constant_layers.h"
#include "networks/model.h"

namespace raymeld {

// Says how a frame is joined with the ones before it.
struct Joining {
  bool settles = true;        // the fused image is mixed with that of the last frame: see settle()
  bool motion_depth = false;  // the motion has depths: see accumulate()
};

// Adds the whole network to the graph. It reads LRHS (height, width, 3) in kLrhsSlot, if at all, and the K
// channels of image_layers() of HRLS (s height, s width, K) in kHrlsSlot, if K is not 0, or, as images, each
// layer in its layer_slot(). It writes the fused image (s height, s width, 3). `phase` says where LRHS
// samples lie in their s x s full-size pixels (see DecodeOptions), and `choose` how each convolution is
// computed. `exponents` are those of the tensors that it makes. `compute_variance` is that of image_layers().
// `samples` matter to a model that knows_spp. With `joining` HRLS is joined with the frames before it: see
// accumulate(); history_channels() says for which models that is possible. Throws an Error that names the
// layer.
void network(Graph& graph, const Model& model, uint32_t height, uint32_t width, float phase,
             const Conv2dChoice& choose = conv2d_direct, const StorageExponents& exponents = {},
             const ConstantLayers& constants = {}, bool compute_variance = false,
             const SampleCounts& samples = {}, const std::optional<Joining>& joining = {});

// Returns the channels of HRLS of which a history is kept. Throws an Error that names the model unless it is
// a pyramid network that knows_spp, whose variance, if it reads any, is computed by the device and its last
// layer, and unless LRHS is an ordinary small render.
uint32_t history_channels(const Model& model, float phase, bool compute_variance);

// Estimates the activations that the model's weights make of encoded images.
ActivationEstimate estimate_activations(const Model& model);

// Returns the exponents with which the activations expected of encoded images fit into 16-bit storage.
StorageExponents storage_exponents(const Model& model);

inline constexpr uint32_t kWholeFrame = 1u << 24;  // a halo that no frame is larger than

// Returns on how many LRHS pixels in each direction the s x s output pixels of an LRHS pixel can depend,
// which is how far tiles must overlap, or kWholeFrame. With `temporal` other frames are read as well, but of
// this one no more than the halo.
uint32_t receptive_halo(const Architecture& architecture, bool compute_variance = false,
                        bool temporal = false);

// Lists the shapes of a network's convolutions in the order in which network() asks for them.
std::vector<Conv2dShape> conv2d_shapes(const Model& model, uint32_t height, uint32_t width);

// Returns whether F(4, 3) is accurate enough for a layer: the error that rounding brings into a tile through
// its brightest pixel must be expected to stay under a quarter of a step of an 8-bit display. This is
// sqrt(n) u A R <= 2^-10, where n is the number of roundings in one sum of winograd_channels(), u = 2^-24, A
// is winograd_amplification(), and R is the largest encoded radiance, as deeper layers are about as large as
// their inputs. `algorithm` is kWinograd or kColumns.
bool tile_4_is_accurate(const Architecture& architecture, const ConvWeights& weights, uint32_t channels_in,
                        uint32_t kernel, Algorithm algorithm);

}  // namespace raymeld
