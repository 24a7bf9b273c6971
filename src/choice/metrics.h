#pragma once

#include "io/image.h"

namespace raymeld {

// All functions compare two (3, H, W) scene-linear images, and throw Error when a size differs. The equations
// are those of Hou et al. 2021.

// Computes the PSNR in dB with peak 1 of images in sRGB by Eq. 3 (the BCR convention); +Inf for equal images.
double psnr_srgb(const Image& image, const Image& reference);

// Holds the constants of Eq. 11, lambda1 (image - reference)^2 / (reference^2 + lambda2).
struct RelMseLambdas {
  double lambda1;
  double lambda2;
};
inline constexpr RelMseLambdas kRelMseBcr = {0.5, 0.01};
inline constexpr RelMseLambdas kRelMseGharbi = {1.0, 1e-4};

// Computes the mean of Eq. 11 over all pixels and channels.
double relmse(const Image& image, const Image& reference, RelMseLambdas lambdas = kRelMseBcr);

// Returns (1, H, W), each pixel's mean of Eq. 11 over its channels.
Image relmse_map(const Image& image, const Image& reference, RelMseLambdas lambdas = kRelMseBcr);

}  // namespace raymeld
