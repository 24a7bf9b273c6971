#pragma once

#include "layers/layers.h"
#include "layers/shaders.h"
#include "params.h"

namespace raymeld {

// Returns push constants for shaders that upsample `lrhs` to the size of `full`; see
// DecodeOptions for scale and phase.
inline params::Upsampled upsampled(const Graph& graph, const Tensor& full, const Tensor& lrhs,
                                   Transfer transfer, uint32_t scale, float phase) {
  return {full.shape.height,
          full.shape.width,
          graph.plane(full),
          lrhs.shape.height,
          lrhs.shape.width,
          graph.plane(lrhs),
          transfer == Transfer::kLog,
          1.0f / static_cast<float>(scale),
          phase};
}

}  // namespace raymeld
