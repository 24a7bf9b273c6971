// The models that come with raymeld, by name.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace raymeld {

// Where they are looked for, in this order: $RAYMELD_MODELS; share/raymeld/models where the program or
// library that this code is part of is installed, wherever it was moved to; the source tree's, for what is
// run where it was built.
std::vector<std::filesystem::path> model_folders();

// Their names, in alphabetical order.
std::vector<std::string> stock_models();

// The file NAME.safetensors in the first folder that has one; empty: none has.
std::filesystem::path find_stock_model(const std::string& name);

// The file that `wanted` means: a path, which has a '/' or ends in .safetensors or is that of a file; else
// the name of a stock model. Throws Error, listing the models there are.
std::filesystem::path model_file(const std::string& wanted);

// "there are x2-fast, x4-fast in /usr/share/raymeld/models", all folders.
std::string what_models_there_are();

}  // namespace raymeld
