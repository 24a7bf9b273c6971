#include "cli/common/models.h"

#include <algorithm>
#include <functional>
#include <optional>
#include <vector>

#include "error.h"
#include "networks/stock_models.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

// Returns 4 for "x4", and none for a text that is not a scale.
std::optional<int> scale_of(const std::string& text) {
  for (const int scale : {2, 4, 8}) {
    if (text == fmt::format("x{}", scale)) return scale;
  }
  return std::nullopt;
}

}  // namespace

Task task_of(const Architecture& architecture) {
  if (!architecture.reads_hrls()) return Task::kUpscale;
  return architecture.reads_lrhs() ? Task::kFuse : Task::kDenoise;
}

fs::path find_model(const std::string& wanted, Task task) {
  const auto scale = scale_of(wanted);
  return scale && find_stock_model(wanted).empty() ? default_model(task, *scale) : model_file(wanted);
}

std::vector<int> pair_scales(int model_scale) {
  return model_scale == 4 ? std::vector{4, 8} : std::vector{model_scale};
}

std::vector<CurvePoint> models_of(Task task, int scale) {
  std::vector<CurvePoint> points = stock_curve().points;
  std::erase_if(points, [&](const CurvePoint& point) {
    const auto scales = task == Task::kFuse ? pair_scales(int(point.scale)) : std::vector{int(point.scale)};
    return point.task != task || std::ranges::count(scales, scale) == 0 ||
           find_stock_model(point.model).empty();
  });
  const auto is_own = [&](const CurvePoint& point) { return int(point.scale) == scale; };
  if (std::ranges::any_of(points, is_own)) std::erase_if(points, std::not_fn(is_own));
  if (points.empty() && task == Task::kDenoise)
    throw Error("there is no stock model that denoises; --model names one; {}", what_models_there_are());
  if (points.empty() && task == Task::kUpscale)
    throw Error("there is no stock model that upscales by {}; --model names one; {}", scale,
                what_models_there_are());
  if (points.empty()) throw Error("there is no model for scale {}; {}", scale, what_models_there_are());
  return points;
}

fs::path default_model(Task task, int scale) {
  std::vector<Candidate> candidates;
  for (const CurvePoint& point : models_of(task, scale)) candidates.push_back({point, point.time_ms});
  return find_stock_model(at_level(front_of(std::move(candidates)), kBalanced).point.model);
}

Curve stock_curve() {
  std::error_code error;
  for (const fs::path& folder : model_folders()) {
    const fs::path file = folder / "curve.json";
    if (fs::is_regular_file(file, error)) return load_curve(file);
  }
  throw Error("there is no curve.json, which has the times and PSNR of models, beside the stock models; {}",
              what_models_there_are());
}

std::shared_ptr<const Model> LastModel::load(const fs::path& file) {
  if (!model_ || file != file_) model_ = std::make_shared<const Model>(file);
  file_ = file;
  return model_;
}

}  // namespace raymeld::cli
