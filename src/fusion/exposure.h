// Finds the factor that brings an image of any brightness to the level that a model was trained at.
#pragma once

#include <cstddef>

namespace raymeld {

inline constexpr float kLeastExposure = 0x1p-24f, kMostExposure = 0x1p24f;

// Returns key / m^2, within the limits above, where m is the mean over LRHS, or over HRLS for a model that
// reads it alone, planar (3, pixels), of the square root of luminance (Rec. 709) of colors in [0, 65504], NaN
// as 0. Returns 1 for a black image, or when `key` is 0. The layer exposure() computes it on the device.
float exposure_of(const float* lrhs, size_t pixels, float key);

// Throws Error unless the limits above hold.
void check_exposure(float exposure);

}  // namespace raymeld
