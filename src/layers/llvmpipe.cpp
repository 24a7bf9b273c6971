#include "layers/llvmpipe.h"

#include "params.h"

namespace raymeld::llvmpipe {
namespace {

constexpr uint32_t kInputVector = 8;  // winograd_input_vectors.comp knows this size only

bool is_laid_out(uint32_t vector) { return vector > 0 && RAYMELD_LANES % vector == 0; }

}  // namespace

uint32_t product_vector(const Conv2dKernel& how, uint32_t items) {
  return is_laid_out(how.vector) && items / how.vector <= kUniformNumbers ? how.vector : 0;
}

uint32_t paired_vector(const Graph& graph, const Convolution& conv, uint32_t band_tiles) {
  static_assert(2 * kPairedVector == RAYMELD_LANES);
  const bool paired = graph.addressed() && conv.channels_out <= kUniformNumbers &&
                      product_vector(conv.options.how, band_tiles) == kPairedVector;
  return paired ? kPairedVector : 0;
}

uint32_t input_vector(const Graph& graph, const Convolution& conv, uint32_t band_tiles) {
  const bool possible =
      graph.addressed() && graph.storage() == Storage::kFloat32 && conv.options.unshuffle == 1 &&
      conv.options.kernel == 3 && conv.options.how.tile == 4 && conv.width % kInputVectorPixels == 0 &&
      conv.channels_in <= kUniformNumbers && product_vector(conv.options.how, band_tiles) == kInputVector;
  return possible ? kInputVector : 0;
}

uint32_t unshuffled_vector(const Graph& graph, uint32_t side) {
  const uint32_t vector = graph.vector();
  const bool possible = is_laid_out(vector) && vector % side == 0 && graph.storage() == Storage::kFloat32;
  return possible ? vector : 0;
}

bool numbers_unshuffled(const Convolution& conv, uint32_t vector) {
  static_assert(kUnshuffledPixels * sizeof(float) <= Graph::kGuardBytes);
  return conv.height <= kUniformNumbers && divide_up(conv.in.shape.width, 2 * vector) <= kUniformNumbers;
}

}  // namespace raymeld::llvmpipe
