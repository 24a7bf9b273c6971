#include "layers/shaders.h"

#define RAYMELD_SPIRV(name)                              \
  extern const std::span<const uint32_t> k_##name##_f32; \
  extern const std::span<const uint32_t> k_##name##_f16;
RAYMELD_SPIRV(conv2d)
RAYMELD_SPIRV(space_to_depth)
RAYMELD_SPIRV(pixel_shuffle)
RAYMELD_SPIRV(encode)
RAYMELD_SPIRV(decode)
#undef RAYMELD_SPIRV

namespace raymeld::shaders {

const Shader kConv2d{"conv2d", k_conv2d_f32, k_conv2d_f16};
const Shader kSpaceToDepth{"space_to_depth", k_space_to_depth_f32, k_space_to_depth_f16};
const Shader kPixelShuffle{"pixel_shuffle", k_pixel_shuffle_f32, k_pixel_shuffle_f16};
const Shader kEncode{"encode", k_encode_f32, k_encode_f16};
const Shader kDecode{"decode", k_decode_f32, k_decode_f16};

}  // namespace raymeld::shaders
