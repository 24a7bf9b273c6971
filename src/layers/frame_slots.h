// The images of a frame, as the layers number them.
#pragma once

#include "engine/graph.h"

namespace raymeld {

inline constexpr FrameSlot kLrhsSlot = 0, kFusedSlot = 1;
// HRLS is one buffer, with all of its layers, or as many images of Vulkan as it has layers, from this slot
// on.
inline constexpr FrameSlot kHrlsSlot = 2;
inline constexpr uint32_t kMostLayers = kFrameSlots - kHrlsSlot;

// Returns the slot of HRLS's layer i, which has three channels.
constexpr FrameSlot layer_slot(uint32_t i) { return kHrlsSlot + i; }

}  // namespace raymeld
