// Holds the time and the PSNR of each model on a test set, as `raymeld trade` measures them, and chooses a
// model by them.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace raymeld {

// Names what a model does: it fuses both renders, or denoises HRLS or upscales LRHS alone.
enum class Task { kFuse, kDenoise, kUpscale };

// Holds words for a task: its command, what that does, and what its results are.
struct TaskWords {
  const char *command, *doing, *done;
};

// Returns the words for a task.
inline constexpr TaskWords words_of(Task task) {
  switch (task) {
    case Task::kFuse:
      return {"fuse", "fusing", "fused"};
    case Task::kDenoise:
      return {"denoise", "denoising", "denoised"};
    case Task::kUpscale:
      return {"upscale", "upscaling", "upscaled"};
  }
  return {};
}

struct CurvePoint {
  std::string model;
  uint32_t scale = 0;
  double time_ms = 0;  // time of a frame of the test set
  double psnr_db = 0;  // mean over the test set's scenes, with the fewest samples
  Task task = Task::kFuse;
};

struct Curve {
  std::string device, data;  // the device and the test set of the measurement
  std::vector<CurvePoint> points;
};

// Both use JSON, and throw an Error that names the file.
Curve load_curve(const std::filesystem::path& file);
void save_curve(const std::filesystem::path& file, const Curve& curve);

// Holds a model that may be chosen, and its time on the device at hand.
struct Candidate {
  CurvePoint point;
  double time_ms = 0;
};

// Returns the candidates that no other beats in time and PSNR, the fastest first.
std::vector<Candidate> front_of(std::vector<Candidate> candidates);

inline constexpr double kBalanced = 50;  // the default level
inline constexpr double kLeastGain = 0.1;

// Chooses by `level`, from 0, the fastest, to 100, the best. Between them a doubling of the time must bring
// (100 - level) / level times kLeastGain dB. The front must not be empty.
const Candidate& at_level(std::span<const Candidate> front, double level);

// Returns the best candidate that takes no longer than `time_ms`, or the fastest if all take longer.
const Candidate& within_budget(std::span<const Candidate> front, double time_ms);

}  // namespace raymeld
