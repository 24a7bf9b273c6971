// Measures how long a frame takes on a device, once for each model and size, and keeps the times in a file.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>

#include "engine/pipeline_cache.h"
#include "fusion/plan.h"
#include "platform/folders.h"

namespace raymeld {

// Holds the times of frames in which everything is computed. The first includes making the Fuser, with
// kernels from the device's cache on disk; further ones are Fuser::fuse() alone.
struct FrameTime {
  double first_ms = 0, further_ms = 0;

  bool operator==(const FrameTime&) const = default;
};

// Returns the milliseconds since some moment in the past.
using MillisecondClock = std::function<double()>;
double steady_ms();

// Holds the times known for a device. Their file lies in `folder`; nothing is kept if `folder` is empty.
class FrameTimes {
 public:
  static constexpr double kMostPixels = 1 << 21;

  // Treats an absent, truncated or foreign file as an empty one. measure() explains `most_pixels`.
  explicit FrameTimes(const Device& device, const std::filesystem::path& folder = default_cache_folder(),
                      MillisecondClock clock = steady_ms, double most_pixels = kMostPixels);

  // Returns the times of a frame of (height, width) LRHS pixels, if they were measured before.
  std::optional<FrameTime> known(const Model& model, uint32_t height, uint32_t width,
                                 FuserOptions options) const;

  // Measures the times with frames of noise, and keeps them. Frames of more than `most_pixels` fused pixels
  // are measured at a smaller size, and their times are scaled by the arithmetic. Throws Error.
  FrameTime measure(const Model& model, uint32_t height, uint32_t width, FuserOptions options);

  // Deletes the file, as its times are those of other kernels.
  static void forget(const Device& device, const std::filesystem::path& folder = default_cache_folder());

 private:
  const Device& device_;
  std::filesystem::path folder_, file_;
  MillisecondClock clock_;
  double most_pixels_;
  std::map<std::string, FrameTime> times_;
};

}  // namespace raymeld
