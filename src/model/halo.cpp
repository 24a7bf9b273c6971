#include "model/halo.h"

#include <algorithm>

#include "model/network.h"
#include "numbers.h"

namespace raymeld {

namespace {

// Returns the right-most LRHS pixel that the output pixels of LRHS pixel `own` of a pyramid network depend
// on. `result` and `joined` are the right-most pixels of filter.i and join.i that are needed, level by level.
uint32_t pyramid_reach(const Architecture& a, uint32_t own, bool compute_variance) {
  const auto levels = static_cast<uint32_t>(a.widths.size());
  uint32_t result = a.scale * (own + 1) - 1, joined = result + 1;  // rec; filter.0 reaches less far than hrls
  std::vector<uint32_t> skipped;
  for (uint32_t level = 1; level < levels; ++level) {
    skipped.push_back(joined + 1);
    result = (result + 1) / 2;                        // upsampled bilinearly
    joined = std::max((joined + 1) / 2, result + 1);  // join and up of the level above, or kernel
  }
  skipped.push_back(joined + 1);
  uint32_t x = (joined + 1) / 2 + 2, lrhs = 0;  // join, up, deep.i
  for (uint32_t level = levels - 1; level > 0; --level) {
    x = std::max(2 * x + 1, skipped[level]) + 1;  // down, and level or lrhs
    if (level == a.levels()) lrhs = x;
  }
  x = 2 * (x + 1) + 1;  // hrls
  x += 1;               // a firefly's neighbours
  if (compute_variance) x += 1;
  return std::max(x / a.scale, lrhs);
}

// Returns the largest reach of the LRHS pixels within one of the coarsest level, as whole ones.
uint32_t pyramid_halo(const Architecture& a, bool compute_variance) {
  uint32_t most = 0;
  for (uint32_t own = 0; own < a.grid(); ++own)
    most = std::max(most, pyramid_reach(a, own, compute_variance) - own);
  return divide_up(most, a.grid()) * a.grid();
}

}  // namespace

// Follows the right-most output pixel of LRHS pixel 0 back through the longest paths to LRHS and to HRLS. A
// 3x3 reaches one pixel further at its own resolution, and a shuffle moves to the outermost pixel of the
// other one.
uint32_t receptive_halo(const Architecture& a, bool compute_variance) {
  if (a.is_pyramid()) return pyramid_halo(a, compute_variance);
  if (a.kind == NetworkKind::kEdsr) {
    uint32_t x = a.scale;                                     // rec
    for (uint32_t i = 0; i < a.levels(); ++i) x = x / 2 + 1;  // up.i
    return x + 1 + 2 * a.blocks + 1;                          // body, blocks.i, head
  }
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
