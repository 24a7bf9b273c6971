#include "layers/shaders.h"

#define RAYMELD_SPIRV(name, form)                                 \
  extern const std::span<const uint32_t> k_##name##_##form##_f32; \
  extern const std::span<const uint32_t> k_##name##_##form##_f16;
#define RAYMELD_SPIRV_FORMS(name) RAYMELD_SPIRV(name, buffers) RAYMELD_SPIRV(name, addresses)
RAYMELD_SPIRV(conv2d, buffers)
extern const std::span<const uint32_t> k_conv2d_matrix;
RAYMELD_SPIRV_FORMS(pointwise)
RAYMELD_SPIRV_FORMS(pointwise_cells)
RAYMELD_SPIRV(pointwise_cells_vectors, buffers)
RAYMELD_SPIRV_FORMS(winograd_weights)
RAYMELD_SPIRV_FORMS(winograd_input)
RAYMELD_SPIRV(winograd_input_vectors, buffers)
RAYMELD_SPIRV_FORMS(winograd_multiply)
RAYMELD_SPIRV_FORMS(winograd_output)
RAYMELD_SPIRV(space_to_depth, buffers)
RAYMELD_SPIRV(pixel_shuffle, buffers)
RAYMELD_SPIRV(exposure_sums, buffers)
RAYMELD_SPIRV(exposure_sums_image, buffers)
RAYMELD_SPIRV(exposure, buffers)
RAYMELD_SPIRV_FORMS(encode)
RAYMELD_SPIRV_FORMS(encode_image)
RAYMELD_SPIRV_FORMS(variance)
RAYMELD_SPIRV_FORMS(variance_image)
RAYMELD_SPIRV_FORMS(highlights)
RAYMELD_SPIRV_FORMS(highlights_image)
RAYMELD_SPIRV_FORMS(decode)
RAYMELD_SPIRV_FORMS(decode_image)
RAYMELD_SPIRV_FORMS(irradiance)
RAYMELD_SPIRV_FORMS(light)
RAYMELD_SPIRV_FORMS(joint_filter)
RAYMELD_SPIRV_FORMS(relight)
RAYMELD_SPIRV_FORMS(mix)
RAYMELD_SPIRV(schedule, buffers)
#undef RAYMELD_SPIRV_FORMS
#undef RAYMELD_SPIRV

namespace raymeld::shaders {

#define RAYMELD_SHADER(name) \
  { #name, k_##name##_buffers_f32, k_##name##_buffers_f16 }
#define RAYMELD_FORMS(name)                                                    \
  {                                                                            \
    {                                                                          \
      {#name ".buffers", k_##name##_buffers_f32, k_##name##_buffers_f16}, {    \
#name ".addresses", k_##name##_addresses_f32, k_##name##_addresses_f16 \
      }                                                                        \
    }                                                                          \
  }
const Shader kConv2d RAYMELD_SHADER(conv2d);
const Shader kConv2dMatrix{"conv2d_matrix", {}, k_conv2d_matrix};
const Forms kPointwise RAYMELD_FORMS(pointwise);
const Forms kPointwiseCells RAYMELD_FORMS(pointwise_cells);
const Shader kPointwiseCellsVectors{"pointwise_cells.vectors", k_pointwise_cells_vectors_buffers_f32, {}};
const Forms kWinogradWeights RAYMELD_FORMS(winograd_weights);
const Forms kWinogradInput RAYMELD_FORMS(winograd_input);
const Shader kWinogradInputVectors{"winograd_input.vectors", k_winograd_input_vectors_buffers_f32, {}};
const Forms kWinogradMultiply RAYMELD_FORMS(winograd_multiply);
const Forms kWinogradOutput RAYMELD_FORMS(winograd_output);
const Shader kSpaceToDepth RAYMELD_SHADER(space_to_depth);
const Shader kPixelShuffle RAYMELD_SHADER(pixel_shuffle);
const Shader kExposureSums RAYMELD_SHADER(exposure_sums);
const Shader kExposureSumsImage RAYMELD_SHADER(exposure_sums_image);
const Shader kExposure RAYMELD_SHADER(exposure);
const Forms kEncode RAYMELD_FORMS(encode);
const Forms kEncodeImage RAYMELD_FORMS(encode_image);
const Forms kVariance RAYMELD_FORMS(variance);
const Forms kVarianceImage RAYMELD_FORMS(variance_image);
const Forms kHighlights RAYMELD_FORMS(highlights);
const Forms kHighlightsImage RAYMELD_FORMS(highlights_image);
const Forms kDecode RAYMELD_FORMS(decode);
const Forms kDecodeImage RAYMELD_FORMS(decode_image);
const Forms kIrradiance RAYMELD_FORMS(irradiance);
const Forms kLight RAYMELD_FORMS(light);
const Forms kJointFilter RAYMELD_FORMS(joint_filter);
const Forms kRelight RAYMELD_FORMS(relight);
const Forms kMix RAYMELD_FORMS(mix);
#undef RAYMELD_FORMS
#undef RAYMELD_SHADER

}  // namespace raymeld::shaders
