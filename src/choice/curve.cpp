#include "choice/curve.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "error.h"
#include "platform/atomic_file.h"

namespace raymeld {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kCurveVersion = 3;

Task task_from(const std::string& name) {
  for (const Task task : {Task::kFuse, Task::kDenoise, Task::kUpscale})
    if (name == words_of(task).command) return task;
  throw Error("task '{}' is unknown", name);
}

Json to_json(const CurvePoint& point) {
  return {{"model", point.model},
          {"task", words_of(point.task).command},
          {"scale", point.scale},
          {"time_ms", point.time_ms},
          {"psnr_db", point.psnr_db}};
}

CurvePoint point_from(const Json& json) {
  const CurvePoint point{json.at("model"), json.at("scale"), json.at("time_ms"), json.at("psnr_db"),
                         task_from(json.at("task"))};
  if (!(point.time_ms > 0)) throw Error("model {} takes {} ms", point.model, point.time_ms);
  return point;
}

}  // namespace

Curve load_curve(const std::filesystem::path& file) try {
  std::ifstream stream(file);
  if (!stream) throw Error("it cannot be read");
  const Json json = Json::parse(stream);
  if (json.at("format_version") != kCurveVersion)
    throw Error("its format_version is {}, expected {}", json.at("format_version").dump(), kCurveVersion);
  Curve curve{json.at("device"), json.at("data"), {}};
  for (const Json& point : json.at("points")) curve.points.push_back(point_from(point));
  return curve;
} catch (const std::exception& error) {
  throw Error("curve '{}': {}", file.string(), error.what());
}

void save_curve(const std::filesystem::path& file, const Curve& curve) {
  Json json{{"format_version", kCurveVersion},
            {"device", curve.device},
            {"data", curve.data},
            {"points", Json::array()}};
  for (const CurvePoint& point : curve.points) json["points"].push_back(to_json(point));
  write_whole(file, json.dump(1) + "\n");
}

std::vector<Candidate> front_of(std::vector<Candidate> candidates) {
  std::ranges::sort(candidates, [](const Candidate& a, const Candidate& b) {
    return a.time_ms != b.time_ms ? a.time_ms < b.time_ms : a.point.psnr_db > b.point.psnr_db;
  });
  std::vector<Candidate> front;
  for (Candidate& candidate : candidates) {
    if (front.empty() || candidate.point.psnr_db > front.back().point.psnr_db)
      front.push_back(std::move(candidate));
  }
  return front;
}

const Candidate& at_level(std::span<const Candidate> front, double level) {
  if (level <= 0) return front.front();
  const double gain = kLeastGain * (100 - level) / level;
  return *std::ranges::max_element(front, {}, [&](const Candidate& candidate) {
    return candidate.point.psnr_db - gain * std::log2(candidate.time_ms);
  });
}

const Candidate& within_budget(std::span<const Candidate> front, double time_ms) {
  const auto beyond = std::ranges::upper_bound(front, time_ms, {}, &Candidate::time_ms);
  return beyond == front.begin() ? front.front() : *std::prev(beyond);
}

}  // namespace raymeld
