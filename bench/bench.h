// Declares what the benchmarks share: one device, one pipeline cache, random values and the measured shapes.
#pragma once

#include <benchmark/benchmark.h>

#include "engine/commands.h"
#include "engine/program.h"
#include "layers/layers.h"

namespace raymeld::bench {

const Device& device();
PipelineCache& cache();

std::vector<float> random_values(size_t count, uint32_t seed);

// Returns the shapes that are measured one by one: those in the table of docs/performance.md and those of the
// stock models.
const std::vector<Conv2dShape>& shapes();
std::string name_of(const Conv2dShape& shape);

void register_device();
void register_convolutions();
void register_frames();
void register_onednn();

}  // namespace raymeld::bench
