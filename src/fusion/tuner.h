// Measures which kernels are fastest on a device, and keeps the result in a file.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "engine/device.h"
#include "engine/pipeline_cache.h"
#include "fusion/conv2d_timer.h"
#include "fusion/plan.h"
#include "layers/layers.h"
#include "platform/folders.h"

namespace raymeld {

// Returns the kernels of a device without measurements. CPUs with buffer addresses get Winograd F(4, 3), or
// F(2, 3) where that is not accurate enough, and pointwise, whose products read vectors where the driver has
// them. They find activations by address where the driver gathers these. In 16-bit storage, other devices
// with cooperative matrices get first_matrix_guess(), but for shapes that dot products of halves compute
// faster. Where neither serves, GPUs get F(m, 3) in columns for a 3x3, as far as their registers are known to
// suffice, and all else the direct kernel.
Kernels default_kernels(const DeviceInfo& device, Storage storage);

// Returns the kernel by cooperative matrices that is the default, and that the search starts from.
Conv2dKernel first_matrix_guess(const CooperativeMatrix& matrix, const Conv2dShape& shape);

// Holds what tune() found: the best kernel of each shape, for one device, driver and storage.
struct Tuning {
  struct Entry {
    Conv2dKernel kernel;
    double time_ms = 0;
    double direct_ms = 0;  // time of the direct kernel
  };
  std::string device, driver;  // what was measured, for whoever reads the file
  bool addressed = false;
  uint32_t order = 8;  // Conv2dKernel::order of all kernels, so that they share pipelines
  std::map<Conv2dShape, Entry> entries;

  // Returns the kernels to compute with. A shape that was not measured gets the kernel of the most similar
  // shape of the same kernel size, or that of default_kernels().
  Kernels kernels(const DeviceInfo& device, Storage storage) const;
};

// Returns where a device's tuning lies in `folder`, or an empty path without a folder.
std::filesystem::path tuning_file(const std::filesystem::path& folder, const Device& device, Storage storage);

// Returns an empty tuning for an absent, truncated or foreign file.
Tuning load_tuning(const std::filesystem::path& file);
// Throws Error.
void save_tuning(const std::filesystem::path& file, const Tuning& tuning);

// Is called for each shape with the kernel that was found. Returns whether to measure the next one; may
// throw.
using TuneProgress = std::function<bool(const Conv2dShape&, const Tuning::Entry&)>;

// Measures the candidates for each shape that `tuning` does not have yet, from that of the most work to that
// of the least. The first time it also measures whether activations are better found by address, and the best
// order. Throws Error.
void tune(const DeviceInfo& device, Storage storage, const Conv2dTimer& time, std::vector<Conv2dShape> shapes,
          Tuning& tuning, const TuneProgress& progress);
// Does the same with time_conv2d() as the timer.
void tune(const Device& device, PipelineCache& cache, Storage storage, const std::vector<Conv2dShape>& shapes,
          Tuning& tuning, const TuneProgress& progress);

// Returns the shapes of a model's convolutions for LRHS of this size, or of the tiles that it is computed in.
std::vector<Conv2dShape> shapes_to_tune(const Device& device, Storage storage, const Model& model,
                                        TileSize lrhs);

// Says what to measure for which folder's tuning_file().
struct TuneFile {
  std::filesystem::path folder;
  std::vector<Conv2dShape> shapes;
  bool again = false;  // measures these shapes even if the file has them
  std::filesystem::path cache_folder = default_cache_folder();  // keeps pipelines
};

// Measures the shapes that the file lacks as tune() does, and saves it after each, so that no end loses a
// measurement. Throws Error.
void tune_file(const Device& device, Storage storage, const TuneFile& file, const TuneProgress& progress);

// Returns the kernels of a device's tuning in `folder`, of what it lacks those of a `shipped` one, or the
// default_kernels() where there is neither.
Kernels kernels_for(const Device& device, Storage storage,
                    const std::filesystem::path& folder = default_cache_folder(),
                    const std::filesystem::path& shipped = {});

}  // namespace raymeld
