#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "io/safetensors.h"
#include "reference/reference.h"

namespace raymeld::conform {

// Returns a model's file as training/ writes it. Metadata in `other` replace those of the architecture.
SafeTensors model_file(const reference::Architecture& architecture, const reference::Weights& weights,
                       const std::map<std::string, std::string>& other = {});

// These read a model's file for the reference. They do not check it, so Model must have loaded it before.
reference::Architecture read_architecture(const std::filesystem::path& model);
reference::Weights read_weights(const std::filesystem::path& model);

}  // namespace raymeld::conform
