// Says what a precision and a choice of kernels mean on a device.
#pragma once

#include <filesystem>

#include "fusion/plan.h"
#include "platform/folders.h"

namespace raymeld {

// Returns options with the storage of the precision and with the kernels of the choice, as kernels_for()
// knows them from `folder` and `shipped`. Tiles that overflow 16-bit storage are computed again in 32 bits if
// the precision is kAuto, or if `redo` is set.
FuserOptions fuser_options(const Device& device, const Model& model, Precision precision, KernelChoice choice,
                           bool redo = false, const std::filesystem::path& folder = default_cache_folder(),
                           const std::filesystem::path& shipped = {});

}  // namespace raymeld
