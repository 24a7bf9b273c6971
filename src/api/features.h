// Lists the features of a device that raymeld can use, and enables them when a caller creates the device.
#pragma once

#include <span>
#include <vector>

#include "engine/device.h"
#include "raymeld/raymeld.h"

namespace raymeld {

// Returns all features; their texts live for ever.
std::vector<raymeld_feature> features_of(const DeviceInfo& info);

// Enables the features that the device supports and whose members are all in the chain. Returns their bits.
uint32_t enable_features(const DeviceInfo& info, VkPhysicalDeviceFeatures2& chain);

// Returns the extensions of these features, which live for ever.
std::span<const char* const> extensions_of(uint32_t bits);

}  // namespace raymeld
