// Finds and loads models: files, or stock models by name.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "choice/curve.h"
#include "networks/model.h"

namespace raymeld::cli {

Task task_of(const Architecture& architecture);

// Returns model_file() of a name or a file, and of a scale such as "x4" the task's default_model(). Throws
// Error, listing the models that exist.
std::filesystem::path find_model(const std::string& wanted, Task task = Task::kFuse);

// Returns the scales of the pairs that a model fuses, its own first: a model of x4 fuses pairs of x8 too.
std::vector<int> pair_scales(int model_scale);

// Returns the points of stock_curve() for a task's stock models of a scale or, where there are none, for
// those that fuse its pairs too. Throws Error when there are none of either.
std::vector<CurvePoint> models_of(Task task, int scale);

// Returns the file of the model at the level kBalanced of the curve.
std::filesystem::path default_model(Task task, int scale);

// Loads curve.json from the first of model_folders() that has one. Throws Error.
Curve stock_curve();

// Loads the models of successive frames, most of which have the same model.
class LastModel {
 public:
  // Returns the model in `file`. Does not read it again if the last call asked for it too. Throws Error.
  std::shared_ptr<const Model> load(const std::filesystem::path& file);

 private:
  std::filesystem::path file_;
  std::shared_ptr<const Model> model_;
};

}  // namespace raymeld::cli
