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

// The data windows where these are `scale` apart; else, where the display windows are, the cells that HRLS's
// data window touches. Empty when neither are, or LRHS has no data there.
std::optional<Canvas> fit(const Windows& lrhs, const Windows& hrls, int scale);

// Whether both data windows start at the same place of the picture, to within a cell.
bool starts_agree(const Windows& lrhs, const Windows& hrls, int scale);

// Returns the part of `canvas` that its full-size window `kept` takes: the cells it touches and `halo` more
// on each side, as far as the canvas goes.
Canvas part_of(const Canvas& canvas, const Imath::Box2i& kept, int halo);

// `image`, whose pixels are those of `from`, seen through the window `to`: cropped, and its edge repeated
// where it has none.
Image seen_through(Image image, const Imath::Box2i& from, const Imath::Box2i& to);

}  // namespace raymeld::cli
