// Measures how good and how steady the images are.
#pragma once

#include "demo.h"

namespace postpass {

struct MeasureOptions {
  uint32_t frames = 32;
  uint32_t converged_samples = 64;   // samples a pixel of a converged image, whose own noise is measured
  uint32_t reference_samples = 256;  // samples a pixel of the reference for a frame of the moving camera
  uint32_t reference_every = 4;      // frames from one reference to the next
  std::filesystem::path images;      // a folder for pictures of the last frame; empty: none
};

// Prints flicker and PSNR of a still and of a moving camera, and of a moving ball and lamp, with and without
// history.
//
// Both are measured on shown values (sRGB). Flicker is the standard deviation over time, averaged over pixels
// and channels, in steps of an 8-bit display; PSNR is against a converged render. Returns the number of
// validation messages.
uint32_t measure(const DemoOptions& options, const MeasureOptions& measure);

}  // namespace postpass
