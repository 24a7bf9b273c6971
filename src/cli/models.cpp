#include "cli/models.h"

#include <fmt/ranges.h>

#include <cstdlib>
#include <optional>
#include <set>
#include <vector>

#include "error.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;
constexpr const char* kExtension = ".safetensors";

std::vector<fs::path> folders() {
  std::vector<fs::path> result;
  if (const char* chosen = std::getenv("RAYMELD_MODELS"); chosen && *chosen) result.push_back(chosen);
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (!error) result.push_back(program.parent_path().parent_path() / "share/raymeld/models");
  result.push_back(RAYMELD_MODEL_DIR);
  return result;
}

fs::path find_name(const std::string& name) {
  std::error_code error;
  for (const fs::path& folder : folders()) {
    const fs::path file = folder / (name + kExtension);
    if (fs::is_regular_file(file, error)) return file;
  }
  return {};
}

// "x4" is 4; none: not a scale.
std::optional<int> scale_of(const std::string& text) {
  for (const int scale : {2, 4, 8}) {
    if (text == fmt::format("x{}", scale)) return scale;
  }
  return std::nullopt;
}

std::set<std::string> names() {
  std::set<std::string> result;
  std::error_code error;
  for (const fs::path& folder : folders()) {
    for (const auto& entry : fs::directory_iterator(folder, error)) {
      if (entry.path().extension() == kExtension) result.insert(entry.path().stem().string());
    }
  }
  return result;
}

std::vector<std::string> folder_names() {
  std::vector<std::string> result;
  for (const fs::path& folder : folders()) result.push_back(folder.string());
  return result;
}

std::string what_there_is() {
  return names().empty() ? fmt::format("there are none in {}", fmt::join(folder_names(), ", "))
                         : fmt::format("there are {}", fmt::join(names(), ", "));
}

}  // namespace

fs::path find_model(const std::string& wanted) {
  if (wanted.find('/') != std::string::npos || wanted.ends_with(kExtension)) return wanted;
  if (const fs::path file = find_name(wanted); !file.empty()) return file;
  if (const auto scale = scale_of(wanted)) return default_model(*scale);
  if (std::error_code error; fs::is_regular_file(wanted, error)) return wanted;
  throw Error("there is no model '{}', neither by name nor as a file; {}", wanted, what_there_is());
}

std::vector<CurvePoint> models_of(int scale) {
  std::vector<CurvePoint> points = stock_curve().points;
  std::erase_if(points, [&](const CurvePoint& point) {
    return int(point.scale) != scale || find_name(point.model).empty();
  });
  if (points.empty()) throw Error("there is no model for scale {}; {}", scale, what_there_is());
  return points;
}

fs::path default_model(int scale) {
  std::vector<Candidate> candidates;
  for (const CurvePoint& point : models_of(scale)) candidates.push_back({point, point.time_ms});
  return find_name(at_level(front_of(std::move(candidates)), kBalanced).point.model);
}

Curve stock_curve() {
  std::error_code error;
  for (const fs::path& folder : folders()) {
    const fs::path file = folder / "curve.json";
    if (fs::is_regular_file(file, error)) return load_curve(file);
  }
  throw Error("there is no curve.json, which says what models cost and bring, in {}",
              fmt::join(folder_names(), ", "));
}

std::vector<std::string> stock_models() {
  const std::set<std::string> all = names();
  return {all.begin(), all.end()};
}

std::shared_ptr<const Model> LastModel::load(const fs::path& file) {
  if (!model_ || file != file_) model_ = std::make_shared<const Model>(file);
  file_ = file;
  return model_;
}

}  // namespace raymeld::cli
