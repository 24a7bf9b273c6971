#include "cli/sequence/sequence_report.h"

#include <fmt/format.h>

#include <algorithm>

#include "cli/sequence/frames.h"

namespace raymeld::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr float kSteadyExposure = 1.05f;

const char* status_name(Status status) {
  switch (status) {
    case Status::kUnfinished:
      return "unfinished";
    case Status::kFused:
      return "fused";
    case Status::kSkipped:
      return "skipped";
    case Status::kLeadIn:
      return "lead-in";
    case Status::kFailed:
      return "failed";
  }
  return "";
}

}  // namespace

std::vector<int> frames_that(Status status, std::span<const Outcome> outcomes) {
  std::vector<int> frames;
  for (const Outcome& outcome : outcomes) {
    if (outcome.status == status) frames.push_back(outcome.frame);
  }
  return frames;
}

std::string exposure_hint(std::span<const Outcome> outcomes) {
  std::vector<std::pair<float, int>> exposures;  // exposure and frame
  for (const Outcome& outcome : outcomes) {
    if (outcome.status == Status::kFused) exposures.emplace_back(outcome.exposure, outcome.frame);
  }
  if (exposures.empty()) return "";
  std::ranges::sort(exposures);
  const auto [least, darkest] = exposures.front();
  const auto [most, brightest] = exposures.back();
  if (most <= kSteadyExposure * least) return "";
  return fmt::format(
      "the input exposure was found frame by frame, from {:.4g} (frame {}) to {:.4g} (frame {}); "
      "--input-exposure {:.4g} keeps it steady",
      least, darkest, most, brightest, exposures[exposures.size() / 2].first);
}

std::string summary_text(Task task, std::span<const Outcome> outcomes, double total_ms) {
  std::string text = fmt::format("{} frames: {} {}", outcomes.size(),
                                 frames_that(Status::kFused, outcomes).size(), words_of(task).done);
  for (const Status status : {Status::kSkipped, Status::kLeadIn, Status::kFailed, Status::kUnfinished}) {
    const std::vector<int> frames = frames_that(status, outcomes);
    if (!frames.empty()) {
      text += fmt::format(", {} {} ({})", frames.size(), status_name(status), frames_text(frames));
    }
  }
  return text + fmt::format("; {:.1f} s", total_ms / 1000);
}

Json summary_json(std::span<const Outcome> outcomes, double total_ms) {
  Json json;
  for (const Status status :
       {Status::kFused, Status::kSkipped, Status::kLeadIn, Status::kFailed, Status::kUnfinished}) {
    json[status_name(status)] = frames_that(status, outcomes);
  }
  json["total_ms"] = total_ms;
  json["frames"] = Json::array();
  for (const Outcome& outcome : outcomes) {
    Json frame = {{"frame", outcome.frame}, {"status", status_name(outcome.status)}};
    if (!outcome.error.empty()) frame["error"] = outcome.error;
    frame.update(outcome.facts);
    json["frames"].push_back(std::move(frame));
  }
  return json;
}

}  // namespace raymeld::cli
