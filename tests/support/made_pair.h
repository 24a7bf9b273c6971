// Makes renders of a made-up scene, for tests of what a pair of renders shows.
#pragma once

#include <cmath>
#include <functional>
#include <random>

#include "io/image.h"

namespace raymeld::test {

// Returns the light of a made-up scene: tiles of many brightnesses under a gradient, without any symmetry.
inline float scene(float x, float y) {
  const int tile = int(std::floor(x / 31)) * 37 + int(std::floor(y / 23)) * 101;
  return (0.1f + float(tile * tile % 89) / 89) * (1 + 0.5f * std::sin(0.02f * x + 0.0001f * y * y));
}

inline Image image_of(int width, int height, const std::function<float(int, int)>& light) {
  Image image(width, height, 3);
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) image.at(c, y, x) = light(x, y);
  return image;
}

struct Pair {
  Image lrhs, hrls;
};

// Returns a noisy HRLS of 384 x 256 and a clean LRHS, which has the mean of each block of scale x scale
// pixels or its top-left pixel.
inline Pair make_pair(int scale, bool centered) {
  std::mt19937 random(7);
  std::exponential_distribution<float> noise(1);
  const auto low = [&](int x, int y) {
    if (!centered) return scene(float(x * scale), float(y * scale));
    float sum = 0;
    for (int i = 0; i < scale * scale; ++i)
      sum += scene(float(x * scale + i % scale), float(y * scale + i / scale));
    return sum / float(scale * scale);
  };
  return {image_of(384 / scale, 256 / scale, low), image_of(384, 256, [&](int x, int y) {
            return scene(float(x), float(y)) * (0.5f + 0.5f * noise(random));
          })};
}

// Mixes the LRHS of a pair at x4 with what another camera sees of the scene. A `share` of 0 leaves the LRHS
// alone, and 1 leaves only the other camera.
inline Image mixed_with_another_camera(const Image& lrhs, float share) {
  return image_of(lrhs.width, lrhs.height, [&](int x, int y) {
    return (1 - share) * lrhs.at(0, y, x) + share * scene(float(4 * x + 700), float(4 * y + 450));
  });
}

inline Image turned(const Image& image, bool mirrored, bool flipped) {
  return image_of(image.width, image.height, [&](int x, int y) {
    return image.at(0, flipped ? image.height - 1 - y : y, mirrored ? image.width - 1 - x : x);
  });
}

inline Image times(Image image, float factor) {
  for (float& value : image.data) value *= factor;
  return image;
}

}  // namespace raymeld::test
