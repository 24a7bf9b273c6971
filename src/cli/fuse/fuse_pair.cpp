// Checks by their pixels whether a pair of files belongs together.
#include <string_view>

#include "cli/fuse/fuse.h"

namespace raymeld::cli {
namespace {

// Returns how LRHS would have to be turned to show the same as HRLS; empty if turning does not help.
std::string_view turn_of(Relation relation) {
  switch (relation) {
    case Relation::kMirrored:
      return "with left and right exchanged";
    case Relation::kFlipped:
      return "with top and bottom exchanged";
    case Relation::kTurned:
      return "turned by 180 degrees";
    default:
      return "";
  }
}

std::string refusal(const FuseFiles& files) {
  const std::string_view turn = turn_of(files.pair.relation);
  std::string text = fmt::format(
      "LRHS '{}' and HRLS '{}' show different things: the correlation of their structures is {:.2f}",
      files.lrhs.path().string(), files.hrls.path().string(), files.pair.correlation);
  return turn.empty() ? text : fmt::format("{}; LRHS {} would match", text, turn);
}

}  // namespace

void examine(const FuseArguments& arguments, FuseFiles& files, Image& lrhs, const Image& hrls,
             std::span<const std::string> layers, Console& console) {
  if (!files.reads_both()) return;
  const bool has_phase =
      files.phase_source == PhaseSource::kOption || files.phase_source == PhaseSource::kFile;
  if (has_phase && arguments.pair_check == PairCheck::kOff) return;
  std::vector<int> guides;
  for (size_t i = 0; i < layers.size(); ++i) {
    if (is_guide(layers[i])) guides.insert(guides.end(), {int(3 * i), int(3 * i + 1), int(3 * i + 2)});
  }
  files.pair = examine_pair(lrhs, hrls, files.frame.scale, guides);
  const PairFindings& found = files.pair;
  if (!has_phase) {
    files.phase = lrhs_phase(!found.is_nearest(), uint32_t(files.frame.scale));
    files.phase_source = found.shows_phase() ? PhaseSource::kPair : PhaseSource::kDefault;
  }
  if (arguments.pair_check == PairCheck::kOff) {
    files.pair.brightness = 1;
    return;
  }
  if (found.is_refused() && arguments.pair_check == PairCheck::kRefuse)
    throw Error("{}; --pair-check warn fuses them anyway", refusal(files));
  if (found.is_refused()) console.warn(refusal(files), 1);
  if (found.relation == Relation::kDoubtful) {
    console.warn(
        fmt::format("LRHS '{}' hardly resembles HRLS '{}': the correlation of their structures is {:.2f}",
                    files.lrhs.path().string(), files.hrls.path().string(), found.correlation),
        1);
  }
  if (found.brightness == 1) return;
  console.warn(
      fmt::format("LRHS '{}' is {:.3g} times as bright as HRLS '{}' and is divided by that; --pair-check off "
                  "leaves it as it is",
                  files.lrhs.path().string(), 1 / found.brightness, files.hrls.path().string()),
      1);
  match_brightness(files, lrhs);
}

void match_brightness(const FuseFiles& files, Image& lrhs) {
  for (float& value : lrhs.data)
    value = std::clamp(value * files.pair.brightness, -kLargestHalf, kLargestHalf);
}

}  // namespace raymeld::cli
