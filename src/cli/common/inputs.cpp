#include "cli/common/inputs.h"

#include <cstring>

#include "error.h"

namespace raymeld::cli {

const std::vector<std::string> kColor = {"color"};

namespace {

// Describes a floating-point type of IEEE 754 by two bit patterns.
template <typename Bits>
struct Format {
  Bits exponent, largest;  // all bits of the exponent; 65504, the largest half
};

template <typename Bits>
NonFinite sanitize_bits(std::vector<char>& bytes, Format<Bits> format, bool mends) {
  constexpr Bits kSign = Bits(Bits{1} << (8 * sizeof(Bits) - 1));
  NonFinite counts;
  for (size_t at = 0; at + sizeof(Bits) <= bytes.size(); at += sizeof(Bits)) {
    Bits bits;
    std::memcpy(&bits, &bytes[at], sizeof(Bits));
    if ((bits & format.exponent) != format.exponent) continue;
    const bool is_nan = Bits(bits & ~kSign) != format.exponent;
    ++(is_nan ? counts.nan : counts.inf);
    bits = is_nan ? Bits{0} : Bits((bits & kSign) | format.largest);
    if (mends) std::memcpy(&bytes[at], &bits, sizeof(Bits));
  }
  return counts;
}

NonFinite sanitize_raw(ExrRawChannel& channel, bool mends) {
  switch (channel.type) {
    case Imf::HALF:
      return sanitize_bits<uint16_t>(channel.bytes, {0x7c00, 0x7bff}, mends);
    case Imf::FLOAT:
      return sanitize_bits<uint32_t>(channel.bytes, {0x7f800000, 0x477fe000}, mends);
    default:
      return {};
  }
}

}  // namespace

void sanitize_passed(ExrRawChannel& channel, bool mends, const char* role, const std::filesystem::path& path,
                     Console& console) {
  const NonFinite counts = sanitize_raw(channel, mends);
  const auto warn = [&](size_t count, const char* what, const char* becomes) {
    if (count > 0)
      console.warn(fmt::format("{} '{}': {} values of channel '{}' are {}; {}", role, path.string(), count,
                               channel.name, what, becomes),
                   count);
  };
  warn(counts.nan, "NaN", mends ? "written as 0" : "written as they are");
  if (mends) warn(counts.inf, "infinite", "written as +-65504");
}

LayerMap map_color(const ExrFile& file, const LayerChoice& choice) {
  LayerChoice color = choice, scope, name;
  std::erase_if(color.overrides, [](const auto& item) { return item.first != "color"; });
  scope = name = color;
  scope.overrides.clear();
  name.view_layer.clear(), name.view.clear();
  for (const LayerChoice& part : {color, scope, name}) {
    try {
      LayerMap map = map_layers(file, part);
      if (map.layers.contains("color")) return map;
    } catch (const Error&) {  // this part does not fit
    }
  }
  return map_layers(file);
}

void sanitize_input(Image& image, const char* role, const std::filesystem::path& path, Console& console) {
  const NonFinite counts = sanitize(image);
  const auto warn = [&](size_t count, const char* what, const char* instead) {
    if (count > 0)
      console.warn(
          fmt::format("{} '{}': {} values are {}; used as {}", role, path.string(), count, what, instead),
          count);
  };
  warn(counts.nan, "NaN", "0");
  warn(counts.inf, "infinite", "+-65504");
}

}  // namespace raymeld::cli
