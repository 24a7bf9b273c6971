// How an LRHS and an HRLS file lie over each other. Windows are as in OpenEXR: `max` is the last pixel.
#pragma once

#include <Imath/ImathBox.h>

#include <optional>

#include "io/exr.h"

namespace raymeld::cli {

struct Windows {
  Imath::Box2i data, display;
};

inline Windows windows_of(const Imf::Header& header) { return {header.dataWindow(), header.displayWindow()}; }

// What is fused: hrls is `scale` times lrhs, each in its file's own pixel coordinates.
struct Canvas {
  int scale = 0;
  Imath::Box2i lrhs, hrls;
};

// The data windows where these are `scale` apart, else the display windows, grown to hold all data. Empty
// when neither are.
std::optional<Canvas> fit(const Windows& lrhs, const Windows& hrls, int scale);

// `image`, whose pixels are those of `from`, seen through the window `to`: cropped, and zero where it has
// none.
Image seen_through(Image image, const Imath::Box2i& from, const Imath::Box2i& to);

}  // namespace raymeld::cli
