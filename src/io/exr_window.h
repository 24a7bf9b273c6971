#pragma once

#include <Imath/ImathBox.h>
#include <OpenEXR/ImfPixelType.h>

#include <cstddef>

namespace raymeld {

// A window's `max` is its last pixel.
inline int width_of(const Imath::Box2i& window) { return window.max.x - window.min.x + 1; }
inline int height_of(const Imath::Box2i& window) { return window.max.y - window.min.y + 1; }

inline size_t size_bytes_of(OPENEXR_IMF_NAMESPACE::PixelType type) {
  return type == OPENEXR_IMF_NAMESPACE::HALF ? 2 : 4;
}

}  // namespace raymeld
