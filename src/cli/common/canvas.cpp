#include "cli/common/canvas.h"

#include <algorithm>
#include <cstdlib>

#include "io/exr_window.h"
#include "numbers.h"

namespace raymeld::cli {
namespace {

using Imath::Box2i;
using Imath::V2i;

bool is_scaled(const Box2i& small, const Box2i& large, int scale) {
  return width_of(large) == int64_t{scale} * width_of(small) &&
         height_of(large) == int64_t{scale} * height_of(small);
}

V2i divide_down(V2i value, int divisor) {
  return {raymeld::divide_down(value.x, divisor), raymeld::divide_down(value.y, divisor)};
}

Box2i moved(const Box2i& window, V2i by) { return {window.min + by, window.max + by}; }

}  // namespace

bool starts_agree(const Windows& lrhs, const Windows& hrls, int scale) {
  const V2i gap = hrls.data.min - hrls.display.min - (lrhs.data.min - lrhs.display.min) * scale;
  return std::abs(gap.x) < scale && std::abs(gap.y) < scale;
}

std::optional<Canvas> fit(const Windows& lrhs, const Windows& hrls, int scale) {
  const bool displays_match = is_scaled(lrhs.display, hrls.display, scale);
  if (is_scaled(lrhs.data, hrls.data, scale) && (!displays_match || starts_agree(lrhs, hrls, scale))) {
    return Canvas{scale, lrhs.data, hrls.data};
  }
  if (!displays_match) return std::nullopt;
  // These are LRHS pixels, counted from the display window's corner, which both files share.
  const Box2i touched(divide_down(hrls.data.min - hrls.display.min, scale),
                      divide_down(hrls.data.max - hrls.display.min, scale));
  if (!touched.intersects(moved(lrhs.data, -lrhs.display.min))) return std::nullopt;
  const Box2i full(touched.min * scale, (touched.max + V2i(1)) * scale - V2i(1));
  return Canvas{scale, moved(touched, lrhs.display.min), moved(full, hrls.display.min)};
}

Canvas part_of(const Canvas& canvas, const Box2i& window, int halo, int grid) {
  const int s = canvas.scale;
  const V2i last = canvas.lrhs.max - canvas.lrhs.min;
  const V2i from = (window.min - canvas.hrls.min) / s - V2i(halo),
            to = (window.max - canvas.hrls.min) / s + V2i(halo);
  const Box2i with_halo({std::max(from.x, 0) / grid * grid, std::max(from.y, 0) / grid * grid},
                        {std::min(to.x, last.x), std::min(to.y, last.y)});
  const Box2i full(with_halo.min * s, (with_halo.max + V2i(1)) * s - V2i(1));
  return {s, moved(with_halo, canvas.lrhs.min), moved(full, canvas.hrls.min)};
}

Canvas upsampled(const Canvas& canvas, int factor) {
  return {canvas.scale / factor,
          {canvas.lrhs.min * factor, (canvas.lrhs.max + V2i(1)) * factor - V2i(1)},
          canvas.hrls};
}

Image seen_through(Image image, const Box2i& from, const Box2i& to) {
  if (from == to) return image;
  Image result(width_of(to), height_of(to), image.channels);
  for (int c = 0; c < image.channels; ++c) {
    for (int y = 0; y < result.height; ++y) {
      const int from_y = std::clamp(y + to.min.y - from.min.y, 0, image.height - 1);
      for (int x = 0; x < result.width; ++x) {
        const int from_x = std::clamp(x + to.min.x - from.min.x, 0, image.width - 1);
        result.at(c, y, x) = image.at(c, from_y, from_x);
      }
    }
  }
  return result;
}

}  // namespace raymeld::cli
