// Decides which cases a device cannot compute, which are then reported as unsupported.
#pragma once

#include "conform/collector.h"

namespace raymeld::conform {

// Returns the name that `raymeld devices` has for the missing feature; empty where the device lacks none.
std::string missing_feature(const DeviceInfo& device, const Method& method, reference::Precision precision);

}  // namespace raymeld::conform
