// How long a frame takes on a device: measured once for each model and size, and kept in a file.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>

#include "engine/pipeline_cache.h"
#include "fusion/plan.h"

namespace raymeld {

// Times of a frame in which everything is computed. The first one counts all that a Fuser takes to be made,
// with kernels that the device's cache on disk has; further ones are Fuser::fuse() alone.
struct FrameTime {
  double first_ms = 0, further_ms = 0;

  bool operator==(const FrameTime&) const = default;
};

// Returns the milliseconds since some moment in the past.
using MillisecondClock = std::function<double()>;
double steady_ms();

// What is known of a device: the file lies in `folder`, or nothing is kept where that is empty.
class FrameTimes {
 public:
  static constexpr double kMostPixels = 1 << 21;

  // A file that is absent, truncated or foreign is as if nothing was measured. `most_pixels`: see measure().
  explicit FrameTimes(const Device& device,
                      const std::filesystem::path& folder = PipelineCache::default_folder(),
                      MillisecondClock clock = steady_ms, double most_pixels = kMostPixels);

  // Of a frame of (height, width) LRHS pixels: what was measured before, if it was.
  std::optional<FrameTime> known(const Model& model, uint32_t height, uint32_t width,
                                 const FuserOptions& options) const;

  // Measures it with frames of noise, and keeps it. Frames of more fused pixels than `most_pixels` are
  // measured as smaller ones, and their time scaled by their arithmetic. Throws Error.
  FrameTime measure(const Model& model, uint32_t height, uint32_t width, FuserOptions options);

  // Of kernels that are no longer those.
  static void forget(const Device& device,
                     const std::filesystem::path& folder = PipelineCache::default_folder());

 private:
  const Device& device_;
  std::filesystem::path folder_, file_;
  MillisecondClock clock_;
  double most_pixels_;
  std::map<std::string, FrameTime> times_;
};

}  // namespace raymeld
