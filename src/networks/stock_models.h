// Finds the models that come with raymeld by name.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace raymeld {

// Lists the folders of stock models in the order in which they are searched: $RAYMELD_MODELS;
// share/raymeld/models of the installation that this program or library is in, wherever it was moved to; and
// the source tree's folder, for programs and libraries that are used where they were built.
std::vector<std::filesystem::path> model_folders();

// Lists the names of the stock models, in alphabetical order.
std::vector<std::string> stock_models();

// Returns the file NAME.safetensors in the first folder that has it, or an empty path if none has.
std::filesystem::path find_stock_model(const std::string& name);

// Returns the file that `wanted` means. `wanted` is a path if it has a '/', ends in .safetensors or names a
// file; else it is the name of a stock model. Throws an Error that lists the models there are.
std::filesystem::path model_file(const std::string& wanted);

// Returns a text such as "there are x2-fast, x4-fast in /usr/share/raymeld/models", with all folders.
std::string what_models_there_are();

}  // namespace raymeld
