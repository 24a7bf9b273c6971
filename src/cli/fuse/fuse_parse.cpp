#include "cli/fuse/fuse_parse.h"

#include <array>
#include <charconv>
#include <climits>
#include <cstdlib>

#include "error.h"
#include "fusion/exposure.h"

namespace raymeld::cli {

float parse_exposure(const std::string& text) {
  if (text == "auto") return 0;
  if (text == "off") return 1;
  char* end = nullptr;
  const float exposure = std::strtof(text.c_str(), &end);
  if (*end != '\0') throw Error("expected auto, off or a number");
  check_exposure(exposure);
  return exposure;
}

std::optional<Imath::Box2i> parse_window(const std::string& text) {
  std::array<int, 4> numbers{};
  const char *next = text.data(), *end = next + text.size();
  bool valid = true;
  for (size_t i = 0; i < numbers.size() && valid; ++i) {
    const auto [behind, error] = std::from_chars(next, end, numbers[i]);
    const bool last = i + 1 == numbers.size();
    valid = error == std::errc() && (last ? behind == end : behind != end && *behind == ',');
    next = behind + 1;
  }
  const auto [x, y, width, height] = numbers;
  const int64_t max_x = int64_t{x} + width - 1, max_y = int64_t{y} + height - 1;
  if (valid && width > 0 && height > 0 && max_x <= INT_MAX && max_y <= INT_MAX)
    return Imath::Box2i({x, y}, {int(max_x), int(max_y)});
  throw Error("expected X,Y,WIDTH,HEIGHT such as 640,360,320,240, of at least one pixel");
}

}  // namespace raymeld::cli
