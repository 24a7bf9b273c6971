// Which kernels are fastest is the device's to say: it is asked, and what it said is kept in a file.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "engine/device.h"
#include "engine/pipeline_cache.h"
#include "layers/layers.h"

namespace raymeld {

// Without measurements. On CPUs with buffer addresses: F(4, 3), or F(2, 3) where that is not accurate enough,
// and pointwise, whose products read vectors where the driver has them; activations by address where it
// gathers them. Otherwise the direct kernel.
Kernels default_kernels(const DeviceInfo& device);

// By cooperative matrices; what the search starts from. Never a default.
Conv2dKernel first_matrix_guess(const CooperativeMatrix& matrix, const Conv2dShape& shape);

// The median of a few runs on random values, in milliseconds; the first, in which some drivers compile, does
// not count. Large images are measured by their first rows and scaled.
double time_conv2d(const Device& device, PipelineCache& cache, Storage storage, bool addressed,
                   const Conv2dShape& shape, const Conv2dKernel& kernel);

// What tune() found: the best kernel of each shape, for one device, driver and storage.
struct Tuning {
  struct Entry {
    Conv2dKernel kernel;
    double time_ms = 0;
    double direct_ms = 0;  // what the direct kernel took
  };
  bool addressed = false;
  uint32_t order = 8;  // of all kernels, so that they share pipelines
  std::map<Conv2dShape, Entry> entries;

  // A shape that was not measured is computed as the most alike of the same kernel size was, or by
  // default_kernels().
  Kernels kernels(const DeviceInfo& device) const;
};

// Where a device's tuning lies in `folder`, or an empty path without a folder.
std::filesystem::path tuning_file(const std::filesystem::path& folder, const Device& device, Storage storage);

// An absent, truncated or foreign file is an empty tuning.
Tuning load_tuning(const std::filesystem::path& file);
// Throws Error.
void save_tuning(const std::filesystem::path& file, const Tuning& tuning);

// Called for each shape with what was found for it; may throw to stop.
using TuneProgress = std::function<void(const Conv2dShape&, const Tuning::Entry&)>;

// Returns the milliseconds that a kernel takes; throws Error where the device cannot compute it.
using Conv2dTimer = std::function<double(bool addressed, const Conv2dShape&, const Conv2dKernel&)>;

// Measures the candidates for each shape that `tuning` has not got yet and, the first time, whether
// activations are better found by address, and the best order. Throws Error.
void tune(const DeviceInfo& device, Storage storage, const Conv2dTimer& time,
          const std::vector<Conv2dShape>& shapes, Tuning& tuning, const TuneProgress& progress);
// The same, with time_conv2d() as the timer.
void tune(const Device& device, PipelineCache& cache, Storage storage, const std::vector<Conv2dShape>& shapes,
          Tuning& tuning, const TuneProgress& progress);

// A device's tuning, if there is one, else its default_kernels().
Kernels kernels_for(const Device& device, Storage storage,
                    const std::filesystem::path& folder = PipelineCache::default_folder());

}  // namespace raymeld
