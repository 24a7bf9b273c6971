#include "layers/shaders.h"

#define RAYMELD_SPIRV(name) extern const std::span<const uint32_t> k_##name;
#define RAYMELD_SPIRV_SHADER(name) RAYMELD_SPIRV(name##_f32) RAYMELD_SPIRV(name##_f16)
#define RAYMELD_SPIRV_FORMS(name) RAYMELD_SPIRV_SHADER(name##_buffers) RAYMELD_SPIRV_SHADER(name##_addresses)
RAYMELD_SPIRV_SHADER(conv2d_buffers)
RAYMELD_SPIRV(conv2d_dots)
RAYMELD_SPIRV_SHADER(conv2d_columns_buffers)
RAYMELD_SPIRV(conv2d_matrix)
RAYMELD_SPIRV_FORMS(pointwise)
RAYMELD_SPIRV_SHADER(pointwise_vectors)
RAYMELD_SPIRV_FORMS(pointwise_unshuffled)
RAYMELD_SPIRV(pointwise_unshuffled_vectors_f32)
RAYMELD_SPIRV_FORMS(winograd_weights)
RAYMELD_SPIRV_FORMS(winograd_input)
RAYMELD_SPIRV(winograd_input_vectors_f32)
RAYMELD_SPIRV_FORMS(winograd_multiply)
RAYMELD_SPIRV(winograd_multiply_vectors_f32)
RAYMELD_SPIRV_FORMS(winograd_output)
RAYMELD_SPIRV_SHADER(winograd_output_vectors)
RAYMELD_SPIRV_SHADER(exposure_sums_buffers)
RAYMELD_SPIRV_SHADER(exposure_sums_image_buffers)
RAYMELD_SPIRV_SHADER(exposure_buffers)
RAYMELD_SPIRV_FORMS(encode)
RAYMELD_SPIRV_FORMS(encode_image)
RAYMELD_SPIRV_FORMS(variance)
RAYMELD_SPIRV_FORMS(variance_image)
RAYMELD_SPIRV_FORMS(above_clip)
RAYMELD_SPIRV_FORMS(above_clip_image)
RAYMELD_SPIRV_FORMS(decode)
RAYMELD_SPIRV_FORMS(decode_image)
RAYMELD_SPIRV_FORMS(remodulate)
RAYMELD_SPIRV_FORMS(kernel_filter)
RAYMELD_SPIRV_FORMS(pool)
RAYMELD_SPIRV_FORMS(light)
RAYMELD_SPIRV_FORMS(cell_light)
RAYMELD_SPIRV_FORMS(compose)
RAYMELD_SPIRV_FORMS(channel_means)
RAYMELD_SPIRV_FORMS(attend)
RAYMELD_SPIRV_FORMS(gradients)
RAYMELD_SPIRV_FORMS(remainder)
RAYMELD_SPIRV_FORMS(light_change)
RAYMELD_SPIRV_FORMS(light_change_image)
RAYMELD_SPIRV_FORMS(accumulate)
RAYMELD_SPIRV_FORMS(accumulate_image)
RAYMELD_SPIRV_FORMS(settle)
RAYMELD_SPIRV_FORMS(settle_image)
RAYMELD_SPIRV_FORMS(color_variance)
RAYMELD_SPIRV_FORMS(cell_share)
#undef RAYMELD_SPIRV_FORMS
#undef RAYMELD_SPIRV_SHADER
#undef RAYMELD_SPIRV

namespace raymeld::shaders {

// clang-format off
#define RAYMELD_SHADER(name) {#name, k_##name##_buffers_f32, k_##name##_buffers_f16}
#define RAYMELD_BY_ADDRESS(name) {#name ".addresses", k_##name##_addresses_f32, k_##name##_addresses_f16}
#define RAYMELD_FORMS(name) {{#name ".buffers", k_##name##_buffers_f32, k_##name##_buffers_f16}, RAYMELD_BY_ADDRESS(name)}
#define RAYMELD_FORMS_AND_VECTORS(name, f16) \
  {{#name ".buffers", k_##name##_buffers_f32, k_##name##_buffers_f16}, RAYMELD_BY_ADDRESS(name), \
   {#name ".vectors", k_##name##_vectors_f32, f16}}
// clang-format on
const Shader kConv2d{"conv2d", k_conv2d_buffers_f32, k_conv2d_buffers_f16, k_conv2d_dots};
const Shader kConv2dColumns{"conv2d_columns", k_conv2d_columns_buffers_f32, k_conv2d_columns_buffers_f16};
const Shader kConv2dMatrix{"conv2d_matrix", {}, k_conv2d_matrix};
const Forms kPointwise RAYMELD_FORMS_AND_VECTORS(pointwise, k_pointwise_vectors_f16);
const Forms kPointwiseUnshuffled RAYMELD_FORMS_AND_VECTORS(pointwise_unshuffled, {});
const Forms kWinogradWeights RAYMELD_FORMS(winograd_weights);
const Forms kWinogradInput RAYMELD_FORMS_AND_VECTORS(winograd_input, {});
// The products have 32 bits whatever the storage.
const Forms kWinogradMultiply RAYMELD_FORMS_AND_VECTORS(winograd_multiply, k_winograd_multiply_vectors_f32);
const Forms kWinogradOutput RAYMELD_FORMS_AND_VECTORS(winograd_output, k_winograd_output_vectors_f16);
const Shader kExposureSums RAYMELD_SHADER(exposure_sums);
const Shader kExposureSumsImage RAYMELD_SHADER(exposure_sums_image);
const Shader kExposure RAYMELD_SHADER(exposure);
const Forms kEncode RAYMELD_FORMS(encode);
const Forms kEncodeImage RAYMELD_FORMS(encode_image);
const Forms kVariance RAYMELD_FORMS(variance);
const Forms kVarianceImage RAYMELD_FORMS(variance_image);
const Forms kAboveClip RAYMELD_FORMS(above_clip);
const Forms kAboveClipImage RAYMELD_FORMS(above_clip_image);
const Forms kDecode RAYMELD_FORMS(decode);
const Forms kDecodeImage RAYMELD_FORMS(decode_image);
const Forms kRemodulate RAYMELD_FORMS(remodulate);
const Forms kKernelFilter RAYMELD_FORMS(kernel_filter);
const Forms kPool RAYMELD_FORMS(pool);
const Forms kLight RAYMELD_FORMS(light);
const Forms kCellLight RAYMELD_FORMS(cell_light);
const Forms kCompose RAYMELD_FORMS(compose);
const Forms kChannelMeans RAYMELD_FORMS(channel_means);
const Forms kAttend RAYMELD_FORMS(attend);
const Forms kGradients RAYMELD_FORMS(gradients);
const Forms kRemainder RAYMELD_FORMS(remainder);
const Forms kLightChange RAYMELD_FORMS(light_change);
const Forms kLightChangeImage RAYMELD_FORMS(light_change_image);
const Forms kAccumulate RAYMELD_FORMS(accumulate);
const Forms kAccumulateImage RAYMELD_FORMS(accumulate_image);
const Forms kSettle RAYMELD_FORMS(settle);
const Forms kSettleImage RAYMELD_FORMS(settle_image);
const Forms kColorVariance RAYMELD_FORMS(color_variance);
const Forms kCellShare RAYMELD_FORMS(cell_share);
#undef RAYMELD_FORMS_AND_VECTORS
#undef RAYMELD_FORMS
#undef RAYMELD_BY_ADDRESS
#undef RAYMELD_SHADER

}  // namespace raymeld::shaders
