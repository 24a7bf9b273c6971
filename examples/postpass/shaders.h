#pragma once

#include <cstdint>
#include <span>

namespace postpass::shaders {

extern const std::span<const uint32_t> kTrace, kAccumulate, kShow, kOverlay;

}  // namespace postpass::shaders
