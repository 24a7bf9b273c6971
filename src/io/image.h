#pragma once

#include <cstddef>
#include <vector>

namespace raymeld {

inline constexpr float kLargestHalf = 65504.0f;

// Holds an image of 32-bit floats, planar and channel-major: (C, H, W), rows from top to bottom.
struct Image {
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<float> data;

  Image() = default;
  // Makes an image of zeros. Throws Error when a size is not positive.
  Image(int width, int height, int channels);

  size_t plane_size() const { return size_t(width) * size_t(height); }
  float* plane(int c) { return data.data() + size_t(c) * plane_size(); }
  const float* plane(int c) const { return data.data() + size_t(c) * plane_size(); }
  float& at(int c, int y, int x) { return plane(c)[size_t(y) * size_t(width) + size_t(x)]; }
  float at(int c, int y, int x) const { return plane(c)[size_t(y) * size_t(width) + size_t(x)]; }
};

// Upsamples (C, h, w) to (C, s*h, s*w) by cubic convolution (Keys 1981, a = -0.5, which is Catmull-Rom), with
// edges replicated. Output pixel X reads u = (X - phase) / s. The phase is 0 for nearest-neighbour LRHS,
// whose samples are the top-left of the s x s pixels they stand for, and (s - 1) / 2 for a real
// low-resolution render.
Image upsample_bicubic(const Image& image, int scale, float phase);

// Does the same by linear interpolation; edges are replicated.
Image upsample_bilinear(const Image& image, int scale, float phase);

// Returns the first `count` channels.
Image first_channels(const Image& image, int count);

// Converts a scene-linear value to sRGB in [0, 1] (Hou et al. 2021, Eq. 3); NaN becomes 0.
float linear_to_srgb(float linear);

struct NonFinite {
  size_t nan = 0;
  size_t inf = 0;
};

// Replaces NaN by 0 and +-Inf by +-kLargestHalf, in place. Returns how many values of each kind there were.
NonFinite sanitize(Image& image);

// Computes for each channel the population variance over each pixel's 3x3 neighbourhood, with edges
// replicated: first the mean, then the squared deviations. NaN and Inf count as 0.
Image variance_3x3(const Image& image);

}  // namespace raymeld
