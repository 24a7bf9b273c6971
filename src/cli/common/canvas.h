// Finds how an LRHS and an HRLS file lie over each other. Windows are as in OpenEXR: `max` is the last pixel.
#pragma once

#include <Imath/ImathBox.h>

#include <optional>

#include "io/exr.h"

namespace raymeld::cli {

struct Windows {
  Imath::Box2i data, display;
};

inline Windows windows_of(const Imf::Header& header) { return {header.dataWindow(), header.displayWindow()}; }

// Holds the windows to fuse: hrls is `scale` times lrhs, each in the pixel coordinates of its own file.
struct Canvas {
  int scale = 0;
  Imath::Box2i lrhs, hrls;
};

// Returns the data windows if HRLS's is `scale` times LRHS's; when the display windows fit too, both data
// windows must also start at the same place. Else, if the display windows fit, returns the LRHS pixels that
// HRLS's data window touches. Returns none when nothing fits or LRHS has no data there.
std::optional<Canvas> fit(const Windows& lrhs, const Windows& hrls, int scale);

// Returns whether both data windows start at the same place of the picture, to within one LRHS pixel.
bool starts_agree(const Windows& lrhs, const Windows& hrls, int scale);

// Returns the part of `canvas` for a full-size window of it: the LRHS pixels that `window` touches and
// `halo` more on each side, within the canvas. It starts at a multiple of `grid` LRHS pixels.
Canvas part_of(const Canvas& canvas, const Imath::Box2i& window, int halo, int grid = 1);

// Returns the canvas with an LRHS that is upsampled by `factor`, which divides the scale.
Canvas upsampled(const Canvas& canvas, int factor);

// Crops `image`, which covers the window `from`, to the window `to`; repeats its edge where it has no pixels.
Image seen_through(Image image, const Imath::Box2i& from, const Imath::Box2i& to);

}  // namespace raymeld::cli
