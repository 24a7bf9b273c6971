#include "cli/common/sizes.h"

#include <charconv>

#include "fusion/plan.h"

namespace raymeld::cli {

TileSize parse_size(const std::string& size) {
  TileSize result;
  const char* end = size.data() + size.size();
  const auto width = std::from_chars(size.data(), end, result.width);
  if (width.ec == std::errc() && width.ptr != end && *width.ptr == 'x') {
    const auto height = std::from_chars(width.ptr + 1, end, result.height);
    if (height.ec == std::errc() && height.ptr == end && result.width > 0 && result.height > 0) return result;
  }
  throw Error("--size is '{}', expected WxH such as 1920x1080", size);
}

TileSize lrhs_size(const Model& model, const std::string& size) {
  const uint32_t scale = model.architecture().scale;
  const TileSize full = parse_size(size);
  if (full.width % scale != 0 || full.height % scale != 0) {
    throw Error("--size {} is not a multiple of the scale {} of model {}", size, scale, model.name());
  }
  const TileSize lrhs{full.height / scale, full.width / scale};
  check_lrhs_size(lrhs);
  return lrhs;
}

}  // namespace raymeld::cli
