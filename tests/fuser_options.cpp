#include "fuser_options.h"

#include "gpu.h"
#include "fusion/tuner.h"

namespace raymeld::test {

std::vector<FuserOptions> all_options() {
  std::vector<FuserOptions> all;
  const uint32_t lanes = gpu().info().vector_lanes;
  const Kernels addressed = default_kernels(gpu().info());
  Kernels buffers, small;
  small.vector = lanes;  // by address, where the rest is in buffers
  buffers.conv2d = [=](const Conv2dShape& shape) {
    Conv2dKernel kernel = addressed.conv2d(shape);
    kernel.vector = 0;
    return kernel;
  };
  small.conv2d = [=](const Conv2dShape& shape) {
    return Conv2dKernel{.tile = shape.kernel == 1 ? 1u : 2u,
                        .outputs = 5,
                        .channels = 4,
                        .order = 2,
                        .band = 12,
                        .vector = lanes};
  };
  // What is by address, and compiled in a tenth of the time, is first and last, and in 32 bits where there is
  // one.
  std::vector<Kernels> ways{{}};
  if (gpu().info().buffer_device_address) ways = {addressed, {}, buffers, small};
  for (size_t i = 0; i < ways.size(); ++i)
    for (const auto precision : kPrecisions)
      if (full_extent() || (precision == reference::Precision::kFp32) == (i == 0 || i == 3))
        all.push_back({.storage = storage_of(precision), .kernels = ways[i]});
  return all;
}

std::string describe(const FuserOptions& options) {
  return fmt::format("{} bytes, tile {}, addressed {}, {} lanes", element_bytes(options.storage),
                     options.kernels.conv2d({8, 8, 4, 4, 3}).tile, options.kernels.addressed,
                     options.kernels.vector);
}

}  // namespace raymeld::test
