// Which part of a frame needs no network, told by the host before anything is planned.
#pragma once

#include "model.h"
#include "tiling.h"

namespace raymeld {

// What agreement of HRLS and LRHS counts as: see FuserOptions::threshold.
inline constexpr float kDefaultThreshold = 0.01f;
// What is needed takes longer in a sparse graph, so below some share it does not pay: a bit longer, but half
// as long again where convolutions of a dense one read vectors (DeviceInfo::vector_lanes), as its own do not.
inline constexpr double kLeastSettledShare = 0.15, kLeastSettledShareOfVectors = 0.75;

// The share of blocks of a frame, lrhs (3, h, w) and hrls (3 or more, s h, s w), planar and dense, that are
// settled: as classify() finds them on the device, but for rounding and for where tiles begin. `frame`: (h,
// w); `phase`: of LRHS samples; `exposure`: what radiance is multiplied by.
double settled_share(const Architecture& architecture, const float* lrhs, const float* hrls, TileSize frame,
                     float phase, float exposure, float threshold);

}  // namespace raymeld
