// Which kernel is fastest for a convolution is the device's to say: it is asked.
#pragma once

#include <vector>

#include "engine/device.h"
#include "engine/pipeline_cache.h"
#include "layers/layers.h"

namespace raymeld {

// The kernels worth trying for a shape on a device, the direct one first.
std::vector<Conv2dKernel> conv2d_candidates(const Conv2dShape& shape, const DeviceInfo& device);

// Milliseconds that the device takes for a convolution: the median of a few runs of as many of its rows as fit into
// about `budget_ms`. The first run, in which some drivers compile, does not count.
double time_conv2d(const Device& device, PipelineCache& cache, Storage storage, const Conv2dShape& shape,
                   const Conv2dKernel& kernel, double budget_ms = 100);

// Without measurements: Winograd by tiles of 2, or a 1x1 by the same steps, on CPUs; the direct kernel on GPUs.
Conv2dChoice default_conv2d_choice(const DeviceInfo& device);

}  // namespace raymeld
