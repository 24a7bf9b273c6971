#pragma once

#include "model.h"

namespace raymeld {

// Adds the whole network to the graph: from an LRHS image of (height, width, 3) in FrameSlot::kLrhs and an
// HRLS image of (s height, s width, K) in FrameSlot::kHrls to the fused image of (s height, s width, 3).
// `phase`: where LRHS samples lie in their s x s cell (see DecodeOptions). `choose`: how each convolution is computed. Throws Error naming the layer.
void network(Graph& graph, const Model& model, uint32_t height, uint32_t width, float phase,
             const Conv2dChoice& choose = conv2d_direct);

// How many LRHS pixels around a pixel its s x s output pixels can depend on, in each direction.
uint32_t receptive_halo(const Architecture& architecture);

}  // namespace raymeld
