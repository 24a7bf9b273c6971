// What conv2d.cpp and the other files of conv2d share.
#pragma once

#include "conform/collector.h"

namespace raymeld::conform {

// Every kernel of 1x1 or 3x3, with parts, blocks and bands so small that there are several of them.
std::vector<Method> conv2d_methods(const DeviceInfo& device, uint32_t kernel);

// Denormals, infinities, NaN, what 16 bits cannot hold: by kernels of direct sums, which promise more than
// bounds.
void run_specials(Collector& collector);

// Input channels that are constant, and what that means where taps fall on zeros outside the image.
void run_constants(Collector& collector);

}  // namespace raymeld::conform
