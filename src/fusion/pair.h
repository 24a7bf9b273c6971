// What an LRHS and an HRLS say about each other before they are fused. All of it is computed on the host,
// from a bounded number of blocks of the frame, so that it takes milliseconds at any size.
#pragma once

#include <cmath>
#include <span>

#include "io/image.h"

namespace raymeld {

enum class Relation {
  kUnknown,   // too little structure to tell, as in a black or a constant image
  kSame,      // LRHS shows what HRLS shows
  kDoubtful,  // LRHS hardly resembles HRLS
  kMirrored,  // LRHS resembles HRLS once left and right are exchanged
  kFlipped,   // LRHS resembles HRLS once top and bottom are exchanged
  kTurned,    // LRHS resembles HRLS once it is turned by 180 degrees
  kForeign,   // LRHS does not resemble HRLS
};

// Blocks are not as independent as their likelihoods take them to be: below this either phase was seen with
// evidence for the other one (training/evaluation/pair_check.py).
inline constexpr double kLeastPhaseEvidence = 12;

struct PairFindings {
  // The logarithm of the likelihood ratio of centered and nearest LRHS samples; 0 where nothing shows it.
  double phase_evidence = 0;
  bool shows_phase() const { return std::abs(phase_evidence) > kLeastPhaseEvidence; }
  // An LRHS without evidence is centered: an ordinary small render is what people have.
  bool is_nearest() const { return shows_phase() && phase_evidence < 0; }

  Relation relation = Relation::kUnknown;
  double correlation = 0;  // the median over blocks in which HRLS has structure, from -1 to 1
  int structured = 0;      // the number of these blocks

  // LRHS times this is as bright as HRLS; 1 where both agree within the noise or cannot be compared.
  float brightness = 1;

  // The files cannot belong together, beyond doubt.
  bool is_refused() const { return relation > Relation::kDoubtful; }
};

// Examines `lrhs`, (3 or more, h, w), and `hrls`, (3 or more, scale h, scale w), which begin with finite
// scene-linear colors. `guides`: planes of HRLS that have little noise, as albedo and normal; where samples
// are few, these show the phase better than colors. Throws Error when the sizes do not fit.
PairFindings examine_pair(const Image& lrhs, const Image& hrls, int scale, std::span<const int> guides = {});

}  // namespace raymeld
