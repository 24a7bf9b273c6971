#include "layers/shaders.h"

#define RAYMELD_SPIRV(name)                              \
  extern const std::span<const uint32_t> k_##name##_f32; \
  extern const std::span<const uint32_t> k_##name##_f16;
RAYMELD_SPIRV(conv2d)
RAYMELD_SPIRV(space_to_depth)
RAYMELD_SPIRV(pixel_shuffle)
RAYMELD_SPIRV(encode)
RAYMELD_SPIRV(decode)
RAYMELD_SPIRV(irradiance)
RAYMELD_SPIRV(light)
RAYMELD_SPIRV(joint_filter)
RAYMELD_SPIRV(relight)
RAYMELD_SPIRV(mix)
#undef RAYMELD_SPIRV

namespace raymeld::shaders {

const Shader kConv2d{"conv2d", k_conv2d_f32, k_conv2d_f16};
const Shader kSpaceToDepth{"space_to_depth", k_space_to_depth_f32, k_space_to_depth_f16};
const Shader kPixelShuffle{"pixel_shuffle", k_pixel_shuffle_f32, k_pixel_shuffle_f16};
const Shader kEncode{"encode", k_encode_f32, k_encode_f16};
const Shader kDecode{"decode", k_decode_f32, k_decode_f16};
const Shader kIrradiance{"irradiance", k_irradiance_f32, k_irradiance_f16};
const Shader kLight{"light", k_light_f32, k_light_f16};
const Shader kJointFilter{"joint_filter", k_joint_filter_f32, k_joint_filter_f16};
const Shader kRelight{"relight", k_relight_f32, k_relight_f16};
const Shader kMix{"mix", k_mix_f32, k_mix_f16};

}  // namespace raymeld::shaders
