// What each model costs and brings on a test set, as raymeld trade measures it, and which of them to take.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "io/image.h"

namespace raymeld {

// What two renders tell of how good the image will be that is fused of them.
struct FrameTraits {
  double agreement_db = 0;  // PSNR, in sRGB, of HRLS against upsampled LRHS
  double detail_db = 0;     // of the RMS difference, in sRGB, of LRHS pixels below each other
};

// lrhs (3, h, w), hrls (3 or more, s h, s w), the color first, scene linear. `phase`: of LRHS samples.
FrameTraits traits_of(const Image& lrhs, const Image& hrls, float phase);

// The PSNR of a fused image as a linear function of its traits.
struct PsnrEstimate {
  double constant = 0, per_agreement = 0, per_detail = 0;
  double error_db = 0;  // standard deviation, in scenes that it was not fitted to

  double psnr_db(const FrameTraits& traits) const;
  // That the PSNR is at least `target_db`, if errors are normally distributed.
  double probability(const FrameTraits& traits, double target_db) const;
};

struct Observation {
  std::string scene;
  FrameTraits traits;
  double psnr_db = 0;
};

// Needs as many scenes as it takes to know what an unknown one would do.
inline constexpr size_t kLeastScenes = 8;

// By least squares; error_db by leaving out one scene after another. Throws Error when there are fewer than
// kLeastScenes scenes, or they are all alike.
PsnrEstimate fit_psnr(std::span<const Observation> observations);

struct CurvePoint {
  std::string model;
  uint32_t scale = 0;
  double time_ms = 0;  // of a frame of the test set
  double psnr_db = 0;  // mean over its scenes, with the fewest samples
  PsnrEstimate estimate;
};

struct Curve {
  std::string device, data;  // what it was measured on
  std::vector<CurvePoint> points;
};

// JSON. Throw Error, naming the file.
Curve load_curve(const std::filesystem::path& file);
void save_curve(const std::filesystem::path& file, const Curve& curve);

// A model that may be taken, and what it takes on the device at hand.
struct Candidate {
  CurvePoint point;
  double time_ms = 0;
};

// Those that no other beats in time and PSNR, the fastest first.
std::vector<Candidate> front_of(std::vector<Candidate> candidates);

inline constexpr double kBalanced = 50;  // the level that is the default
inline constexpr double kLeastGain = 0.1;

// `level` is from 0, the fastest, to 100, the best. Between them a doubling of the time must bring (100 -
// level) / level times kLeastGain dB. The front must not be empty.
const Candidate& at_level(std::span<const Candidate> front, double level);

// The best that takes no longer; the fastest where all do.
const Candidate& within_budget(std::span<const Candidate> front, double time_ms);

// The fastest that more likely than not reaches the PSNR; where none does, the best.
const Candidate& for_target(std::span<const Candidate> front, const FrameTraits& traits, double psnr_db);

}  // namespace raymeld
