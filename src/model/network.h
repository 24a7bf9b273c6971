#pragma once

#include "model/activations.h"
#include "model/constant_layers.h"
#include "model/model.h"

namespace raymeld {

// Adds the whole network to the graph: from an LRHS image of (height, width, 3) in kLrhsSlot and an
// HRLS image of (s height, s width, K), of image_layers(), in kHrlsSlot or, as images, of each layer
// in its layer_slot(), to the fused image of (s height, s width, 3). `phase`: where LRHS samples lie in their
// s x s cell (see DecodeOptions). `choose`: how each convolution is computed. `exponents`: of the tensors it
// makes. `constants`: they are in the convolutions' biases. `compute_variance`: as image_layers() has it.
// Throws Error naming the layer.
void network(Graph& graph, const Model& model, uint32_t height, uint32_t width, float phase,
             const Conv2dChoice& choose = conv2d_direct, const StorageExponents& exponents = {},
             const ConstantLayers& constants = {}, bool compute_variance = false);

// What the model's weights are expected to make of encoded images.
ActivationEstimate estimate_activations(const Model& model);

// Those that 16-bit storage takes, so that what the weights are expected to make of encoded images fits.
StorageExponents storage_exponents(const Model& model);

// The shapes of a network's convolutions, in order, as network() asks for them.
std::vector<Conv2dShape> conv2d_shapes(const Model& model, uint32_t height, uint32_t width);

// Whether F(4, 3) is accurate enough for a layer: an error that rounding brings into a tile through its
// brightest pixel is expected to stay under a quarter of a step of an 8-bit display, sqrt(n) u A R <= 2^-10.
// n: roundings of one sum, u = 2^-24; A: winograd_amplification(); R: the largest radiance, encoded, as
// deeper layers are about as large as what they are made of.
bool tile_4_is_accurate(const Architecture& architecture, const ConvWeights& weights, uint32_t channels_in);

// How many LRHS pixels around a pixel its s x s output pixels can depend on, in each direction.
uint32_t receptive_halo(const Architecture& architecture, bool compute_variance = false);

}  // namespace raymeld
