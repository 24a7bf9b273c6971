// Says where the shaders of shaders/llvmpipe, which read vectors of floats, can compute a pass. Each function
// returns how many lanes a vector has, or 0 where another form of the shader must compute the pass.
#pragma once

#include "layers/conv2d.h"

namespace raymeld::llvmpipe {

inline constexpr uint32_t kUniformNumbers = 4096;   // uniform_number() returns numbers below this
inline constexpr uint32_t kInputVectorPixels = 64;  // pixels of a row for winograd_input_vectors.comp
inline constexpr uint32_t kUnshuffledPixels = 64;  // pixels of pointwise_unshuffled_vectors.comp's workgroups

// Serves pointwise and winograd_multiply, whose products of `items` pixels or tiles lie in scratch memory.
uint32_t product_vector(const Conv2dKernel& how, uint32_t items);

// Serves winograd_multiply whose invocations compute two tiles, one vector apart, and winograd_output.
uint32_t paired_vector(const Graph& graph, const Convolution& conv, uint32_t band_tiles);

// Serves winograd_input.
uint32_t input_vector(const Graph& graph, const Convolution& conv, uint32_t band_tiles);

// Serves the weights of pointwise_unshuffled. The result is the same for all sizes of a frame, as the layout
// of the weights depends on it. A frame may be too large for the shader itself: see numbers_unshuffled().
uint32_t unshuffled_vector(const Graph& graph, uint32_t side);
bool numbers_unshuffled(const Convolution& conv, uint32_t vector);

}  // namespace raymeld::llvmpipe
