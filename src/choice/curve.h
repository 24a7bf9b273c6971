// Holds the time and the PSNR of each model on a test set, as `raymeld trade` measures them, and chooses a
// model by them.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "io/image.h"

namespace raymeld {

// Holds properties of two renders that predict the quality of the image fused from them.
struct FrameTraits {
  double agreement_db = 0;  // PSNR, in sRGB, of HRLS against upsampled LRHS
  double detail_db = 0;     // RMS difference, in sRGB, of LRHS pixels below each other
};

// Computes the traits of lrhs (3, h, w) and hrls (3 or more, s h, s w), with the color first, both scene
// linear. `phase` is that of LRHS samples (see upsample_bicubic()).
FrameTraits traits_of(const Image& lrhs, const Image& hrls, float phase);

// Estimates the PSNR of a fused image as a linear function of its traits.
struct PsnrEstimate {
  double constant = 0, per_agreement = 0, per_detail = 0;
  double error_db = 0;  // standard deviation, in scenes that were not in the fit

  double psnr_db(const FrameTraits& traits) const;
  // Returns the probability that the PSNR is at least `target_db`, if errors are normally distributed.
  double probability(const FrameTraits& traits, double target_db) const;
};

struct Observation {
  std::string scene;
  FrameTraits traits;
  double psnr_db = 0;
};

// Fewer scenes do not suffice to predict an unknown scene.
inline constexpr size_t kLeastScenes = 8;

// Fits an estimate by least squares. Each scene's error, for error_db, is that of a fit to the other scenes.
// Throws Error when there are fewer than kLeastScenes scenes, or when they are all alike.
PsnrEstimate fit_psnr(std::span<const Observation> observations);

struct CurvePoint {
  std::string model;
  uint32_t scale = 0;
  double time_ms = 0;  // time of a frame of the test set
  double psnr_db = 0;  // mean over the test set's scenes, with the fewest samples
  PsnrEstimate estimate;
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

// Returns the fastest candidate that reaches the PSNR with a probability of at least one half, or the best if
// none does.
const Candidate& for_target(std::span<const Candidate> front, const FrameTraits& traits, double psnr_db);

}  // namespace raymeld
