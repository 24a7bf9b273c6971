#pragma once

#include <functional>
#include <span>
#include <vector>

#include "engine/device.h"
#include "engine/pipeline_cache.h"
#include "layers/layers.h"

namespace raymeld {

// Returns the milliseconds that each of the kernels takes, infinity for one that the device cannot compute.
using Conv2dTimer =
    std::function<std::vector<double>(bool addressed, const Conv2dShape&, std::span<const Conv2dKernel>)>;

// Measures a layer with random weights, its shuffles included: the kernels run in turns, and the median
// counts. Where they do not fit the memory side by side, they run one after another. On GPUs the device's
// clock tells, after enough work for the device to have reached its speed. Large images are measured by their
// first rows, and the time is scaled; the first run does not count, in which drivers compile. Throws Error
// where the device cannot compute the direct kernel, and DeviceLost.
std::vector<double> time_conv2d(const Device& device, PipelineCache& cache, Storage storage, bool addressed,
                                const Conv2dShape& shape, std::span<const Conv2dKernel> kernels);

}  // namespace raymeld
