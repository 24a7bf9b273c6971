// Examines an LRHS and an HRLS before they are fused. All of it is computed on the host, from a bounded
// number of blocks of the frame, so that it takes milliseconds at any size.
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

// Blocks are less independent than their likelihoods take them to be: below this, pairs of either phase were
// seen with evidence for the other one (training/evaluation/pair_check.py).
inline constexpr double kLeastPhaseEvidence = 12;

struct PairFindings {
  // Holds the logarithm of the likelihood ratio of centered to nearest LRHS samples; 0 without evidence.
  double phase_evidence = 0;
  bool shows_phase() const { return std::abs(phase_evidence) > kLeastPhaseEvidence; }
  // Returns false without evidence: people have ordinary small renders, whose samples are centered.
  bool is_nearest() const { return shows_phase() && phase_evidence < 0; }

  Relation relation = Relation::kUnknown;
  double correlation = 0;  // the median over blocks in which HRLS has structure, from -1 to 1
  int structured = 0;      // the number of these blocks

  // LRHS times this is as bright as HRLS; 1 where both agree within the noise or cannot be compared.
  float brightness = 1;

  // Returns whether the files cannot belong together, beyond doubt.
  bool is_refused() const { return relation > Relation::kDoubtful; }
};

// Examines `lrhs`, (3 or more, h, w), and `hrls`, (3 or more, scale h, scale w), which begin with finite
// scene-linear colors. `guides` are planes of HRLS that have little noise, such as albedo and normal; where
// samples are few, these show the phase better than colors. Throws Error when the sizes do not fit.
PairFindings examine_pair(const Image& lrhs, const Image& hrls, int scale, std::span<const int> guides = {});

}  // namespace raymeld
