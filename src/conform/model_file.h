#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "io/safetensors.h"
#include "reference/reference.h"

namespace raymeld::conform {

// A model's file as training/ writes it; `other` metadata take the place of what follows from the
// architecture.
SafeTensors model_file(const reference::Architecture& architecture, const reference::Weights& weights,
                       const std::map<std::string, std::string>& other = {});

// What a file of a model holds that is known to be right, as Model loaded it, for running the reference on
// it.
reference::Architecture read_architecture(const std::filesystem::path& model);
reference::Weights read_weights(const std::filesystem::path& model);

}  // namespace raymeld::conform
