// Has what networks share that upscale LRHS alone: EDSR and RCAN. They convolve at LRHS's size and upscale by
// pixel shuffles. Beyond their papers, the output is added to the bilinearly upsampled LRHS, so that they
// begin with that.
#pragma once

#include "networks/builder.h"
#include "networks/entries.h"

namespace raymeld {

// Reads the features and the sampling of LRHS, of which there is one.
void parse_upscaler(const Entries& entries, Architecture& a);

struct UpscalerBuilder : Builder {
  uint32_t height, width;  // the size of LRHS
  float phase;
  Tensor lrhs, bright;  // encoded LRHS, and its radiance above the clip

  // Encodes LRHS.
  UpscalerBuilder(const Builder& builder, uint32_t height, uint32_t width, float phase);
  // Adds a 3x3 convolution (h, w, c) -> (h, w, C).
  Tensor conv3x3(const std::string& name, const Tensor& in, bool relu = false,
                 const std::optional<Tensor>& residual = {});
  // Upscales `x` (h, w, C), and writes the output.
  void finish(Tensor x);
};

// Returns the halo, in LRHS pixels, of rec, the up.i and `layers` 3x3 convolutions before them.
uint32_t upscaler_halo(const Architecture& a, uint32_t layers);

}  // namespace raymeld
