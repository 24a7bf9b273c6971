// What a device may have for raymeld, and how it is asked for when a caller creates it.
#pragma once

#include <span>
#include <vector>

#include "engine/device.h"
#include "raymeld/raymeld.h"

namespace raymeld {

// All features; their texts live for ever.
std::vector<raymeld_feature> features_of(const DeviceInfo& info);

// Enables what the device supports and the chain has all members of. Returns the features' bits.
uint32_t enable_features(const DeviceInfo& info, VkPhysicalDeviceFeatures2& chain);

// Returns the extensions of these features, which live for ever.
std::span<const char* const> extensions_of(uint32_t bits);

}  // namespace raymeld
