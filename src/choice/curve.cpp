#include "choice/curve.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "choice/metrics.h"
#include "error.h"
#include "platform/atomic_file.h"

namespace raymeld {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kCurveVersion = 1;
constexpr size_t kTerms = 3;
using Terms = std::array<double, kTerms>;

Terms terms_of(const FrameTraits& traits) { return {1, traits.agreement_db, traits.detail_db}; }

// Solves m x = y by Gaussian elimination with pivots. Throws Error unless there is exactly one x.
Terms solve(std::array<Terms, kTerms> m, Terms y) {
  for (size_t i = 0; i < kTerms; ++i) {
    size_t pivot = i;
    for (size_t row = i + 1; row < kTerms; ++row) {
      if (std::abs(m[row][i]) > std::abs(m[pivot][i])) pivot = row;
    }
    std::swap(m[i], m[pivot]);
    std::swap(y[i], y[pivot]);
    if (std::abs(m[i][i]) < 1e-9)
      throw Error("the scenes are too similar to fit an estimate of the PSNR to them");
    for (size_t row = i + 1; row < kTerms; ++row) {
      const double factor = m[row][i] / m[i][i];
      for (size_t column = i; column < kTerms; ++column) m[row][column] -= factor * m[i][column];
      y[row] -= factor * y[i];
    }
  }
  Terms x{};
  for (size_t i = kTerms; i-- > 0;) {
    x[i] = y[i];
    for (size_t column = i + 1; column < kTerms; ++column) x[i] -= m[i][column] * x[column];
    x[i] /= m[i][i];
  }
  return x;
}

// Fits the estimate to all scenes but `left_out`.
PsnrEstimate fit_without(std::span<const Observation> observations, const std::string& left_out) {
  std::array<Terms, kTerms> products{};
  Terms sums{};
  for (const Observation& observation : observations) {
    if (observation.scene == left_out) continue;
    const Terms terms = terms_of(observation.traits);
    for (size_t i = 0; i < kTerms; ++i) {
      for (size_t j = 0; j < kTerms; ++j) products[i][j] += terms[i] * terms[j];
      sums[i] += terms[i] * observation.psnr_db;
    }
  }
  const Terms solved = solve(products, sums);
  return {solved[0], solved[1], solved[2]};
}

Json to_json(const CurvePoint& point) {
  const PsnrEstimate& estimate = point.estimate;
  return {{"model", point.model},
          {"scale", point.scale},
          {"time_ms", point.time_ms},
          {"psnr_db", point.psnr_db},
          {"estimate",
           {{"constant", estimate.constant},
            {"per_agreement", estimate.per_agreement},
            {"per_detail", estimate.per_detail},
            {"error_db", estimate.error_db}}}};
}

CurvePoint point_from(const Json& json) {
  const Json& estimate = json.at("estimate");
  CurvePoint point{json.at("model"),
                   json.at("scale"),
                   json.at("time_ms"),
                   json.at("psnr_db"),
                   {estimate.at("constant"), estimate.at("per_agreement"), estimate.at("per_detail"),
                    estimate.at("error_db")}};
  if (!(point.time_ms > 0))
    throw Error("time_ms of model {} is {}, expected more than 0", point.model, point.time_ms);
  return point;
}

}  // namespace

FrameTraits traits_of(const Image& lrhs, const Image& hrls, float phase) {
  Image color(hrls.width, hrls.height, 3);
  std::copy_n(hrls.data.begin(), color.data.size(), color.data.begin());
  double squares = 0;
  for (int c = 0; c < 3; ++c)
    for (int y = 1; y < lrhs.height; ++y)
      for (int x = 0; x < lrhs.width; ++x) {
        const double difference =
            double(linear_to_srgb(lrhs.at(c, y, x))) - double(linear_to_srgb(lrhs.at(c, y - 1, x)));
        squares += difference * difference;
      }
  // Both traits are limited, as they are infinite for images without detail or that agree to the bit.
  constexpr double kMostDb = 60;
  const double mean = squares / double(lrhs.data.size());
  const double agreement = psnr_srgb(color, upsample_bicubic(lrhs, hrls.width / lrhs.width, phase));
  return {std::min(agreement, kMostDb), std::max(10 * std::log10(mean), -kMostDb)};
}

double PsnrEstimate::psnr_db(const FrameTraits& traits) const {
  return constant + per_agreement * traits.agreement_db + per_detail * traits.detail_db;
}

double PsnrEstimate::probability(const FrameTraits& traits, double target_db) const {
  return std::erfc((target_db - psnr_db(traits)) / (error_db * std::sqrt(2.0))) / 2;
}

PsnrEstimate fit_psnr(std::span<const Observation> observations) {
  std::set<std::string> scenes;
  for (const Observation& observation : observations) scenes.insert(observation.scene);
  if (scenes.size() < kLeastScenes)
    throw Error("{} scenes are too few to fit an estimate of the PSNR, expected at least {}", scenes.size(),
                kLeastScenes);
  double squares = 0;
  for (const std::string& scene : scenes) {
    const PsnrEstimate others = fit_without(observations, scene);
    for (const Observation& observation : observations) {
      if (observation.scene == scene)
        squares += std::pow(observation.psnr_db - others.psnr_db(observation.traits), 2);
    }
  }
  PsnrEstimate estimate = fit_without(observations, {});
  estimate.error_db = std::sqrt(squares / double(observations.size()));
  return estimate;
}

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

const Candidate& for_target(std::span<const Candidate> front, const FrameTraits& traits, double psnr_db) {
  const auto probability = [&](const Candidate& candidate) {
    return candidate.point.estimate.probability(traits, psnr_db);
  };
  const auto reaches =
      std::ranges::find_if(front, [&](const Candidate& candidate) { return probability(candidate) >= 0.5; });
  return reaches != front.end() ? *reaches : front.back();
}

}  // namespace raymeld
