#include "cli/fuse/choice.h"

#include <charconv>
#include <cmath>

#include "cli/common/inputs.h"
#include "platform/interrupt.h"
#include "choice/frame_times.h"
#include "io/exr_window.h"

namespace raymeld::cli {
namespace {

// Splits `text` into the number that it begins with, or NaN, and the rest.
std::pair<double, std::string> number_of(const std::string& text) {
  double value = NAN;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return {error == std::errc() ? value : NAN, std::string(end, text.data() + text.size())};
}

std::string duration_text(double time_ms) {
  return time_ms < 1000 ? fmt::format("{:.3g} ms", time_ms) : fmt::format("{:.3g} s", time_ms / 1000);
}

std::string wish_text(const Wish& wish) {
  switch (wish.kind) {
    case Wish::Kind::kLevel:
      return fmt::format("--quality {:g}", wish.value);
    case Wish::Kind::kBudget:
      return fmt::format("--budget {}", duration_text(wish.value));
    case Wish::Kind::kTarget:
      return fmt::format("--target-psnr {:g}", wish.value);
  }
  return "";
}

// Gives the times of models on the device, for the frame at hand.
struct Timer {
  const FuseArguments& arguments;
  const Device& device;
  LastModel& models;
  Console& console;
  bool sequence;
  FrameTimes times{device};

  // Returns none if the model was not measured and `measures` is false.
  std::optional<double> of(const CurvePoint& point, bool measures) {
    FuseArguments own = arguments;
    own.model = point.model;
    const FuseFiles files = open_files(own, models);
    const FuserOptions options = fuser_options(own, files, device, files.absent_layers);
    const auto height = uint32_t(height_of(files.canvas.lrhs)), width = uint32_t(width_of(files.canvas.lrhs));
    auto time = times.known(*files.model, height, width, options);
    if (!time && measures) {
      check_interrupted();
      console.note(fmt::format("measuring {} at {} x {}, once on this device", point.model,
                               width_of(files.canvas.hrls), height_of(files.canvas.hrls)));
      time = times.measure(*files.model, height, width, options);
    }
    if (!time) return {};
    return sequence ? time->further_ms : time->first_ms;
  }
};

struct Candidates {
  std::vector<Candidate> all;
  bool measured = true;  // times are of this device; else they are the curve's
};

Candidates candidates_of(const std::vector<CurvePoint>& points, Timer& timer, bool measures) {
  Candidates candidates;
  for (const CurvePoint& point : points) {
    const auto time_ms = timer.of(point, measures);
    candidates.measured = candidates.measured && time_ms;
    candidates.all.push_back({point, time_ms.value_or(0)});
  }
  if (!candidates.measured) {
    for (Candidate& candidate : candidates.all) candidate.time_ms = candidate.point.time_ms;
  }
  return candidates;
}

FrameTraits read_traits(const FuseArguments& arguments, LastModel& models) {
  FuseFiles files = open_files(arguments, models);
  Console silent(false);  // warnings come when the pixels are read to be fused
  const ColorPair colors = load_colors(arguments, files, silent);
  return traits_of(colors.lrhs, colors.hrls, files.phase);
}

std::string text_of(const Choice& choice, const std::string& best, size_t models) {
  std::string text = fmt::format("{}: {}", choice.wish, choice.model);
  if (choice.time_ms) text += fmt::format(", {} a frame on this device", duration_text(*choice.time_ms));
  text += choice.loss_db > 0
              ? fmt::format(", {:.2f} dB below {}, the best of {}", choice.loss_db, best, models)
              : fmt::format(", the best of {}", models);
  if (choice.probability) {
    text +=
        fmt::format("; {:.1f} +- {:.1f} dB expected, which reaches the target with a probability of {:.0f} %",
                    choice.estimate_db, choice.error_db, 100 * *choice.probability);
  }
  return text;
}

double checked(double value, bool holds, const char* expected) {
  if (!holds || !std::isfinite(value)) throw Error("expected {}", expected);
  return value;
}

}  // namespace

std::optional<Wish> parse_quality(const std::string& text) {
  if (text == "fast") return Wish{Wish::Kind::kLevel, 0};
  if (text == "balanced") return Wish{Wish::Kind::kLevel, kBalanced};
  if (text == "high") return Wish{Wish::Kind::kLevel, 100};
  const auto [level, rest] = number_of(text);
  return Wish{Wish::Kind::kLevel, checked(level, rest.empty() && level >= 0 && level <= 100,
                                          "high, balanced, fast or a number from 0 to 100")};
}

std::optional<Wish> parse_budget(const std::string& text) {
  const auto [value, unit] = number_of(text);
  return Wish{Wish::Kind::kBudget,
              checked(unit == "s" ? 1000 * value : value, (unit == "s" || unit == "ms") && value > 0,
                      "a time such as 16ms or 2s")};
}

std::optional<Wish> parse_target(const std::string& text) {
  const auto [value, rest] = number_of(text);
  return Wish{Wish::Kind::kTarget, checked(value, rest.empty(), "a number of dB")};
}

Choice choose_model(const FuseArguments& arguments, bool sequence, const Device& device, LastModel& models,
                    Console& console) {
  const Wish& wish = arguments.wish.value();
  const FuseFiles files = open_files(arguments, models);
  const std::vector<CurvePoint> points = models_of(files.canvas.scale);
  Timer timer{arguments, device, models, console, sequence};
  const Candidates candidates = candidates_of(points, timer, wish.kind == Wish::Kind::kBudget);
  const std::vector<Candidate> front = front_of(candidates.all);

  Choice choice;
  const Candidate* chosen = nullptr;
  if (wish.kind == Wish::Kind::kTarget) {
    const FrameTraits traits = read_traits(arguments, models);
    chosen = &for_target(front, traits, wish.value);
    const PsnrEstimate& estimate = chosen->point.estimate;
    choice.estimate_db = estimate.psnr_db(traits);
    choice.error_db = estimate.error_db;
    choice.probability = estimate.probability(traits, wish.value);
  } else {
    chosen =
        wish.kind == Wish::Kind::kLevel ? &at_level(front, wish.value) : &within_budget(front, wish.value);
  }
  choice.model = chosen->point.model;
  choice.wish = wish_text(wish);
  if (candidates.measured) choice.time_ms = chosen->time_ms;
  choice.loss_db = front.back().point.psnr_db - chosen->point.psnr_db;

  console.note(text_of(choice, front.back().point.model, points.size()));
  if (wish.kind == Wish::Kind::kBudget && chosen->time_ms > wish.value)
    console.warn(fmt::format("{} is too short: the fastest model takes {}", choice.wish,
                             duration_text(chosen->time_ms)),
                 1);
  if (choice.probability.value_or(1) < 0.5)
    console.warn(fmt::format("no model is expected to reach {}: using {}, the best, with {:.1f} dB expected",
                             choice.wish, choice.model, choice.estimate_db),
                 1);
  return choice;
}

nlohmann::ordered_json to_json(const Choice& choice) {
  nlohmann::ordered_json json{{"asked", choice.wish}, {"model", choice.model}, {"loss_db", choice.loss_db}};
  if (choice.time_ms) json["time_ms"] = *choice.time_ms;
  if (choice.probability) {
    json["expected_psnr_db"] = choice.estimate_db;
    json["expected_error_db"] = choice.error_db;
    json["probability"] = *choice.probability;
  }
  return json;
}

}  // namespace raymeld::cli
