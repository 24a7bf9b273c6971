#include "cli/fuse/choice.h"

#include <charconv>
#include <cmath>

#include "choice/frame_times.h"
#include "cli/common/inputs.h"
#include "io/exr_window.h"
#include "platform/interrupt.h"

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

std::string request_text(const ModelRequest& request) {
  switch (request.kind) {
    case ModelRequest::Kind::kLevel:
      return fmt::format("--quality {:g}", request.value);
    case ModelRequest::Kind::kBudget:
      return fmt::format("--budget {}", duration_text(request.value));
  }
  return "";
}

// Gives the times of models on the device, for the frame at hand.
struct Timer {
  const FuseArguments& arguments;
  const Device& device;
  LastModel& models;
  Console& console;
  FuseFiles& frame;
  bool sequence;
  FrameTimes times{device};
  std::optional<int> runs = {};  // the network's runs for a frame

  // Returns none if the model was not measured and `measures` is false.
  std::optional<double> of(const CurvePoint& point, bool measures) {
    FuseArguments own = arguments;
    own.model = point.model;
    const FuseFiles files = open_files(own, models);
    const FuserOptions options = options_of(own, files, device, files.absent_layers);
    const auto height = uint32_t(height_of(files.canvas.lrhs)), width = uint32_t(width_of(files.canvas.lrhs));
    auto time = times.known(*files.model, height, width, options);
    if (!time && measures) {
      check_interrupted();
      console.note(fmt::format("measuring {} at {} x {}, once on this device", point.model,
                               width_of(files.canvas.hrls), height_of(files.canvas.hrls)));
      time = times.measure(*files.model, height, width, options);
    }
    if (!time) return {};
    if (!runs) runs = count_runs(frame, arguments);
    return (sequence ? time->further_ms : time->first_ms) + (*runs - 1) * time->further_ms;
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

std::string text_of(const Choice& choice, const std::string& best, size_t models) {
  std::string text = fmt::format("{}: {}", choice.request, choice.model);
  if (choice.time_ms) text += fmt::format(", {} a frame on this device", duration_text(*choice.time_ms));
  text += choice.loss_db > 0
              ? fmt::format(", {:.2f} dB below {}, the best of {}", choice.loss_db, best, models)
              : fmt::format(", the best of {}", models);
  return text;
}

double checked(double value, bool holds, const char* expected) {
  if (!holds || !std::isfinite(value)) throw Error("expected {}", expected);
  return value;
}

}  // namespace

std::optional<ModelRequest> parse_quality(const std::string& text) {
  if (text == "fast") return ModelRequest{ModelRequest::Kind::kLevel, 0};
  if (text == "balanced") return ModelRequest{ModelRequest::Kind::kLevel, kBalanced};
  if (text == "high") return ModelRequest{ModelRequest::Kind::kLevel, 100};
  const auto [level, rest] = number_of(text);
  return ModelRequest{ModelRequest::Kind::kLevel, checked(level, rest.empty() && level >= 0 && level <= 100,
                                                          "high, balanced, fast or a number from 0 to 100")};
}

std::optional<ModelRequest> parse_budget(const std::string& text) {
  const auto [value, unit] = number_of(text);
  return ModelRequest{ModelRequest::Kind::kBudget,
                      checked(unit == "s" ? 1000 * value : value, (unit == "s" || unit == "ms") && value > 0,
                              "a time such as 16ms or 2s")};
}

Choice choose_model(const FuseArguments& arguments, bool sequence, const Device& device, LastModel& models,
                    Console& console) {
  const ModelRequest& request = arguments.request.value();
  FuseFiles files = open_files(arguments, models);
  const std::vector<CurvePoint> points = models_of(arguments.task(), files.frame.scale);
  Timer timer{arguments, device, models, console, files, sequence};
  const Candidates candidates = candidates_of(points, timer, request.kind == ModelRequest::Kind::kBudget);
  const std::vector<Candidate> front = front_of(candidates.all);

  Choice choice;
  const Candidate* chosen = request.kind == ModelRequest::Kind::kLevel ? &at_level(front, request.value)
                                                                       : &within_budget(front, request.value);
  choice.model = chosen->point.model;
  choice.request = request_text(request);
  if (candidates.measured) choice.time_ms = chosen->time_ms;
  choice.loss_db = front.back().point.psnr_db - chosen->point.psnr_db;

  console.note(text_of(choice, front.back().point.model, points.size()));
  if (request.kind == ModelRequest::Kind::kBudget && chosen->time_ms > request.value)
    console.warn(fmt::format("{} is too short: the fastest model takes {}", choice.request,
                             duration_text(chosen->time_ms)),
                 1);
  return choice;
}

nlohmann::ordered_json to_json(const Choice& choice) {
  nlohmann::ordered_json json{
      {"asked", choice.request}, {"model", choice.model}, {"loss_db", choice.loss_db}};
  if (choice.time_ms) json["time_ms"] = *choice.time_ms;
  return json;
}

}  // namespace raymeld::cli
