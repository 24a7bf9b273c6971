// Reports on a sequence at its end.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "cli/common/models.h"

namespace raymeld::cli {

// A lead-in frame is not fused; later ones go on with it, where frames are joined in time.
enum class Status { kUnfinished, kFused, kSkipped, kLeadIn, kFailed };

struct Outcome {
  int frame = 0;
  Status status = Status::kUnfinished;
  bool begins_shot = false;  // the frame goes on with no other
  std::string error = {};
  float exposure = 0;                                               // set for a fused frame
  nlohmann::ordered_json facts = nlohmann::ordered_json::object();  // set for a fused frame, with --json
};

std::vector<int> frames_that(Status status, std::span<const Outcome> outcomes);

// Returns a hint that the exposures of fused frames differ by more than a twentieth, with the one to give to
// all frames; empty if they do not.
std::string exposure_hint(std::span<const Outcome> outcomes);

std::string summary_text(Task task, std::span<const Outcome> outcomes, double total_ms);
nlohmann::ordered_json summary_json(std::span<const Outcome> outcomes, double total_ms);

}  // namespace raymeld::cli
