// Declares the functions that conv2d.cpp shares with the other files of conv2d.
#pragma once

#include "conform/collector.h"

namespace raymeld::conform {

// Returns every kernel for a 1x1, 3x3 or 5x5 convolution, cut into several parts, blocks and bands. A CPU has
// the larger tiles of matrices for 3x3 at full extent only, because its driver compiles each kernel for
// minutes.
std::vector<Method> conv2d_methods(const DeviceInfo& device, uint32_t kernel, Extent extent);

// Tests denormals, infinities, NaN and values beyond 16 bits in 1x1 convolutions, whose direct sums promise
// more than bounds, and one poisoned pixel in 3x3 convolutions.
void run_specials(Collector& collector);

}  // namespace raymeld::conform
