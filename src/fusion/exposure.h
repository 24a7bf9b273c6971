// What brings an image of any brightness to the level that a model was trained at.
#pragma once

#include <cstddef>

namespace raymeld {

inline constexpr float kLeastExposure = 0x1p-24f, kMostExposure = 0x1p24f;

// e = key / m^2, where m is the mean over LRHS, planar (3, pixels), of the square root of luminance (Rec.
// 709) of colors in [0, 65504], NaN as 0; within the limits above. 1 for a black LRHS, or when `key` is 0.
// The layer of this name has the device find it.
float exposure_of(const float* lrhs, size_t pixels, float key);

// Throws Error unless the limits above hold.
void check_exposure(float exposure);

}  // namespace raymeld
