// How good and how steady the images are, in numbers.
#pragma once

#include "demo.h"

namespace postpass {

struct MeasureOptions {
  uint32_t frames = 32;
  uint32_t converged_samples = 64;   // of a converged image whose own noise is measured
  uint32_t reference_samples = 256;  // of the truth for a frame of the moving camera
  uint32_t reference_every = 4;      // frames
  std::filesystem::path images;      // a folder for pictures of the last frame; empty: none
};

// Prints flicker and PSNR of a still and of a moving camera.
//
// Flicker is the mean over pixels and channels of the standard deviation over time of what is shown (sRGB),
// in steps of an 8-bit display; PSNR is of what is shown as well, against a converged render. Returns the
// number of validation messages.
uint32_t measure(const DemoOptions& options, const MeasureOptions& measure);

}  // namespace postpass
