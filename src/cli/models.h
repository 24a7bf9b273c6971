// Where models come from: a file, or a stock model by name.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "model.h"

namespace raymeld::cli {

// The file that `wanted` means: a path, the name of a model in one of the folders $RAYMELD_MODELS,
// <program>/../share/raymeld/models and the source tree's models, or a scale such as "x4": balanced, else
// fast, else full. Throws Error, listing the models there are.
std::filesystem::path find_model(const std::string& wanted);

std::filesystem::path default_model(int scale);

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
