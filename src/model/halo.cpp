#include "model/halo.h"

#include <algorithm>

#include "model/network.h"

namespace raymeld {

// Follows the right-most output pixel of LRHS pixel 0 back through the longest paths to LRHS and to HRLS. A
// 3x3 reaches one pixel further at its own resolution, and a shuffle moves to the outermost pixel of the
// other one.
uint32_t receptive_halo(const Architecture& a, bool compute_variance) {
  uint32_t x = a.scale - 1;
  x += a.head_layers + 1;  // head.i, rec
  switch (a.upscale) {
    case Upscale::kDirect:
      x = x / a.scale + 1;  // up.0
      break;
    case Upscale::kHalf:
      x = x / 2 + 1 + a.half_layers;  // up.0, half_layers.i
      x = x / (a.scale / 2) + 1;      // half_up; half_skip reaches less far than the trunk
      break;
    case Upscale::kStages:
      for (uint32_t i = 0; i < a.levels(); ++i) x = x / 2 + 1;  // up.i
  }
  x += a.groups * a.blocks * a.dense_layers;  // the trunk
  const uint32_t lrhs = x + 1;
  if (a.hrls_encoder == HrlsEncoder::kUnshuffled) {
    x = a.scale * (x + a.hrls_kernel / 2) + a.scale - 1;  // hrls
  } else {
    for (uint32_t i = 0; i < a.levels(); ++i) x = 2 * (x + 1) + 1;  // down.i
    x += 1;                                                         // hrls
  }
  if (compute_variance) x += 1;
  if (a.base != Base::kJoint) return std::max(x / a.scale, lrhs);
  x += (1u << kJointLevels) - 1;  // joint.i
  // The upsampled irradiance, a mean of 3x3, reaches further than the neighbours of a firefly.
  return x / a.scale + 2;
}

}  // namespace raymeld
