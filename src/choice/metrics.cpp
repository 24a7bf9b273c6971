#include "choice/metrics.h"

#include <cmath>
#include <limits>

#include "error.h"

namespace raymeld {
namespace {

void check_shapes(const Image& image, const Image& reference) {
  if (image.channels != 3 || reference.channels != 3)
    throw Error("cannot compare images of {} and {} channels: both must be RGB", image.channels,
                reference.channels);
  if (image.width != reference.width || image.height != reference.height)
    throw Error("cannot compare {} x {} with a reference of {} x {}: the sizes must be equal", image.width,
                image.height, reference.width, reference.height);
}

// Returns the mean of error(value, reference value) over all pixels and channels.
template <typename PixelError>
double mean_error(const Image& image, const Image& reference, PixelError&& error) {
  check_shapes(image, reference);
  double sum = 0;
  for (size_t i = 0; i < image.data.size(); ++i) sum += error(image.data[i], reference.data[i]);
  return sum / double(image.data.size());
}

double squared(double value) { return value * value; }

// Computes Eq. 11 for one value.
double relative_error(double value, double truth, RelMseLambdas lambdas) {
  return lambdas.lambda1 * squared(value - truth) / (squared(truth) + lambdas.lambda2);
}

}  // namespace

double psnr_srgb(const Image& image, const Image& reference) {
  const double mse = mean_error(image, reference, [](float value, float truth) {
    return squared(double(linear_to_srgb(value)) - double(linear_to_srgb(truth)));
  });
  return mse == 0 ? std::numeric_limits<double>::infinity() : -10 * std::log10(mse);
}

double relmse(const Image& image, const Image& reference, RelMseLambdas lambdas) {
  return mean_error(image, reference,
                    [&](float value, float truth) { return relative_error(value, truth, lambdas); });
}

Image relmse_map(const Image& image, const Image& reference, RelMseLambdas lambdas) {
  check_shapes(image, reference);
  Image map(image.width, image.height, 1);
  for (size_t i = 0; i < map.data.size(); ++i) {
    double sum = 0;
    for (int c = 0; c < 3; ++c) sum += relative_error(image.plane(c)[i], reference.plane(c)[i], lambdas);
    map.data[i] = float(sum / 3);
  }
  return map;
}

}  // namespace raymeld
