// Where models come from: a file, or a stock model by name.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "choice/curve.h"
#include "model/model.h"

namespace raymeld::cli {

// What model_file() finds, or of a scale such as "x4" its default_model(). Throws Error, listing the models
// there are.
std::filesystem::path find_model(const std::string& wanted);

// The models of a scale that stock_curve() knows. Throws Error when there are none.
std::vector<CurvePoint> models_of(int scale);

// At the level kBalanced of the curve.
std::filesystem::path default_model(int scale);

// The file curve.json in the first of model_folders() that has one. Throws Error.
Curve stock_curve();

// Models of one frame after another, of which most have the same.
class LastModel {
 public:
  // What the file was when it was loaded, if it is the one that was asked for last. Throws Error.
  std::shared_ptr<const Model> load(const std::filesystem::path& file);

 private:
  std::filesystem::path file_;
  std::shared_ptr<const Model> model_;
};

}  // namespace raymeld::cli
