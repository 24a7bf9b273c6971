#pragma once

#include <map>
#include <string>

#include "io/safetensors.h"
#include "reference/reference.h"

namespace raymeld::conform {

// A model's file as training/ writes it; `other` metadata take the place of what follows from the
// architecture.
SafeTensors model_file(const reference::Architecture& architecture, const reference::Weights& weights,
                       const std::map<std::string, std::string>& other = {});

}  // namespace raymeld::conform
