// Numbers the images of a frame for the layers.
#pragma once

#include "engine/graph.h"

namespace raymeld {

inline constexpr FrameSlot kLrhsSlot = 0, kFusedSlot = 1;
// HRLS starts at this slot: it is one buffer with all of its layers, or an image of Vulkan for each layer.
inline constexpr FrameSlot kHrlsSlot = 2;

// Returns the slot of HRLS's layer i, which has three channels.
constexpr FrameSlot layer_slot(uint32_t i) { return kHrlsSlot + i; }

// Motion, and the histories that the last frame left and that this one leaves.
inline constexpr FrameSlot kMotionSlot = 8, kLastSlot = 9, kNextSlot = 10;

}  // namespace raymeld
