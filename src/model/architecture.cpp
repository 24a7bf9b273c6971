// Reads the metadata of a model's file; docs/model-format.md lists the entries.
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <optional>
#include <set>
#include <span>

#include "io/layer_map.h"
#include "model/model.h"

namespace raymeld {
namespace {

using Metadata = std::map<std::string, std::string>;

constexpr uint32_t kMostChannels = 1024, kMostRepeats = 64;

class Entries {
 public:
  Entries(const Metadata& metadata, const std::string& file) : metadata_(metadata), file_(file) {}

  const std::string& text(const std::string& key) const {
    const auto found = metadata_.find(key);
    if (found == metadata_.end()) throw Error("model {}: metadata entry \"{}\" is missing", file_, key);
    return found->second;
  }

  bool has(const std::string& key) const { return metadata_.contains(key); }

  uint32_t integer(const std::string& key, uint32_t least, uint32_t most) const {
    const std::optional<uint32_t> number = parsed(text(key), least, most);
    if (!number) reject(key, fmt::format("an integer from {} to {}", least, most));
    return *number;
  }

  // Returns so many integers, which stand between commas.
  std::vector<uint32_t> integers(const std::string& key, size_t count, uint32_t least, uint32_t most) const {
    const std::vector<std::string> items = list(key);
    std::vector<uint32_t> result;
    for (const std::string& item : items) {
      const std::optional<uint32_t> number = parsed(item, least, most);
      if (number) result.push_back(*number);
    }
    if (items.size() != count || result.size() != count)
      reject(key, fmt::format("{} integers from {} to {}", count, least, most));
    return result;
  }

  // Returns the entry, a positive number, or 0 where `or_zero` allows it.
  float number(const std::string& key, bool or_zero) const {
    const std::string& value = text(key);
    float number = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
    if (error != std::errc() || end != value.data() + value.size() || !std::isfinite(number) || number < 0 ||
        (number == 0 && !or_zero)) {
      reject(key, or_zero ? "a positive number or 0" : "a positive number");
    }
    return number;
  }

  // Returns whether the entry is `yes`; it must be `yes` or `no`.
  bool choice(const std::string& key, const std::string& yes, const std::string& no) const {
    const std::string& value = text(key);
    if (value != yes && value != no) reject(key, fmt::format("\"{}\" or \"{}\"", yes, no));
    return value == yes;
  }

  // Returns the texts between the commas, or none if the entry is empty.
  std::vector<std::string> list(const std::string& key) const {
    const std::string& value = text(key);
    std::vector<std::string> items;
    for (size_t begin = 0; begin <= value.size() && !value.empty();) {
      const size_t end = std::min(value.find(',', begin), value.size());
      items.push_back(value.substr(begin, end - begin));
      begin = end + 1;
    }
    return items;
  }

  [[noreturn]] void reject(const std::string& key, const std::string& expected) const {
    throw Error("model {}: metadata entry \"{}\" is \"{}\", expected {}", file_, key, text(key), expected);
  }

 private:
  // Returns the integer that all of the text is, or nothing if it is none or out of range.
  static std::optional<uint32_t> parsed(const std::string& text, uint32_t least, uint32_t most) {
    uint32_t number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    const bool whole = error == std::errc() && end == text.data() + text.size();
    return whole && number >= least && number <= most ? std::optional(number) : std::nullopt;
  }

  const Metadata& metadata_;
  const std::string& file_;
};

// Returns whether all `items` are among `known` and none occurs twice.
template <typename Known>
bool are_among(const std::vector<std::string>& items, const Known& known) {
  const std::set<std::string_view> all(known.begin(), known.end());
  return std::set(items.begin(), items.end()).size() == items.size() &&
         std::ranges::all_of(items, [&](const std::string& item) { return all.contains(item); });
}

std::vector<std::string> hrls_layers(const Entries& entries) {
  const std::vector<std::string> layers = entries.list("hrls_layers");
  if (layers.empty() || layers.front() != "color" || !are_among(layers, kLayerNames)) {
    entries.reject("hrls_layers",
                   fmt::format("color, then any of {}, each once", fmt::join(kLayerNames, ", ")));
  }
  return layers;
}

std::vector<std::string> optional_layers(const Entries& entries, std::span<const std::string> of) {
  const std::vector<std::string> layers = entries.list("optional_layers");
  if (!are_among(layers, of.subspan(1))) {
    entries.reject("optional_layers", "any of hrls_layers but color, each once");
  }
  return layers;
}

// Sets hrls_encoder and hrls_kernel. Models from before there was a choice of kernel have no entry for it.
void parse_encoder(const Entries& entries, Architecture& a) {
  const bool full = entries.choice("hrls_encoder", "full", "unshuffled");
  a.hrls_encoder = full ? HrlsEncoder::kFull : HrlsEncoder::kUnshuffled;
  if (!entries.has("hrls_kernel")) return;
  a.hrls_kernel = entries.choice("hrls_kernel", "1", "3") ? 1 : 3;
  if (full && a.hrls_kernel != 3) entries.reject("hrls_kernel", "\"3\", as HRLS is not unshuffled");
}

// Sets lrhs_centered and both_samplings.
void parse_sampling(const Entries& entries, Architecture& a) {
  const std::vector<std::string> samplings = entries.list("lrhs_sampling");
  if (samplings.empty() || !are_among(samplings, std::array<std::string_view, 2>{"nearest", "centered"})) {
    entries.reject("lrhs_sampling", "nearest, centered or both, the default first");
  }
  a.lrhs_centered = samplings.front() == "centered";
  a.both_samplings = samplings.size() == 2;
}

// Sets upscale, upscaled_features, half_features and half_layers. Only models that upscale by half size need
// entries for the last two.
void parse_upscale(const Entries& entries, Architecture& a) {
  const bool half = entries.text("upscale") == "half";
  a.upscale = half                                            ? Upscale::kHalf
              : entries.choice("upscale", "stages", "direct") ? Upscale::kStages
                                                              : Upscale::kDirect;
  a.upscaled_features = entries.integer("upscaled_features", 1, kMostChannels);
  if (a.upscale == Upscale::kStages && a.upscaled_features != a.features) {
    entries.reject("upscaled_features",
                   fmt::format("{}, the features that are upscaled in stages", a.features));
  }
  if (!half) return;
  a.half_features = entries.integer("half_features", 1, kMostChannels);
  a.half_layers = entries.integer("half_layers", 1, kMostRepeats);
}

// Sets widths and upscaled_features. The layers that guide the last level come first.
void parse_pyramid(const Entries& entries, Architecture& a) {
  constexpr uint32_t kLevels = 4;
  constexpr std::array<std::string_view, 3> kFirst{"color", "albedo", "normal"};
  if (std::ranges::mismatch(kFirst, a.hrls_layers).in1 != kFirst.end())
    entries.reject("hrls_layers", "color,albedo,normal first, as the network is a pyramid");
  a.widths = entries.integers("widths", kLevels, 1, kMostChannels);
  a.upscaled_features = entries.integer("upscaled_features", 1, kMostChannels);
}

// Sets features, blocks, base and the sampling of LRHS, of which there is one.
void parse_edsr(const Entries& entries, Architecture& a) {
  a.features = entries.integer("features", 1, kMostChannels);
  a.blocks = entries.integer("blocks", 1, kMostRepeats);
  a.base = Base::kBilinear;
  a.lrhs_centered = entries.choice("lrhs_sampling", "centered", "nearest");
}

NetworkKind network_kind(const Entries& entries) {
  if (!entries.has("network")) return NetworkKind::kFusion;
  const std::string& name = entries.text("network");
  if (name == "edsr") return NetworkKind::kEdsr;
  if (name == "pyramid") return NetworkKind::kPyramid;
  if (name != "fusion") entries.reject("network", "\"fusion\", \"pyramid\" or \"edsr\"");
  return NetworkKind::kFusion;
}

Base base(const Entries& entries, std::span<const std::string> hrls_layers) {
  if (entries.text("base") != "joint") {
    return entries.choice("base", "bilinear", "none") ? Base::kBilinear : Base::kNone;
  }
  for (const char* layer : {"albedo", "normal"}) {
    if (std::ranges::find(hrls_layers, layer) == hrls_layers.end()) {
      entries.reject("base", fmt::format("\"bilinear\" or \"none\", as hrls_layers has no {}", layer));
    }
  }
  return Base::kJoint;
}

}  // namespace

Architecture parse_architecture(const Metadata& metadata, const std::string& file) {
  const Entries entries(metadata, file);
  if (entries.text("format") != "raymeld.model") entries.reject("format", "\"raymeld.model\"");
  if (entries.text("format_version") != "1") entries.reject("format_version", "\"1\"");
  Architecture a;
  a.kind = network_kind(entries);
  a.scale = entries.integer("scale", a.is_pyramid() ? 1 : 2, 8);
  if (!std::has_single_bit(a.scale)) entries.reject("scale", a.is_pyramid() ? "1, 2, 4 or 8" : "2, 4 or 8");
  a.transfer = entries.choice("transfer", "log", "linear") ? Transfer::kLog : Transfer::kLinear;
  a.clip = entries.number("clip", false);
  a.exposure_key = entries.number("exposure_key", true);
  if (a.kind == NetworkKind::kEdsr) {
    parse_edsr(entries, a);
    return a;
  }
  a.hrls_layers = hrls_layers(entries);
  a.optional_layers = optional_layers(entries, a.hrls_layers);
  a.knows_spp = entries.has("knows_spp") && entries.choice("knows_spp", "true", "false");
  if (a.reads_lrhs()) {
    a.lrhs_certainty = entries.number("lrhs_certainty", true);
    parse_sampling(entries, a);
  }
  if (a.is_pyramid()) {
    parse_pyramid(entries, a);
    return a;
  }
  a.features = entries.integer("features", 1, kMostChannels);
  a.growth = entries.integer("growth", 1, kMostChannels);
  a.dense_layers = entries.integer("dense_layers", 1, kMostRepeats);
  a.blocks = entries.integer("blocks", 1, kMostRepeats);
  a.groups = entries.integer("groups", 1, kMostRepeats);
  a.long_skip = entries.choice("long_skip", "lrhs", "fused") ? LongSkip::kLrhs : LongSkip::kFused;
  a.merge_relu = entries.choice("merge_relu", "true", "false");
  a.base = base(entries, a.hrls_layers);
  parse_encoder(entries, a);
  parse_upscale(entries, a);
  a.hrls_guide = entries.choice("guide", "hrls", "none");
  a.head_features = entries.integer("head_features", 0, kMostChannels);
  a.head_layers = entries.integer("head_layers", 0, kMostRepeats);
  if ((a.head_layers > 0) != (a.head_features > 0)) {
    entries.reject("head_layers", a.head_features > 0 ? "at least 1, as there are head_features"
                                                      : "0, as there are no head_features");
  }
  return a;
}

SampleCounts SampleCounts::known(uint32_t scale) const {
  return {std::clamp(lrhs > 0 ? lrhs : float(scale * scale), 1.0f, 256.0f),
          std::clamp(hrls > 0 ? hrls : 1.0f, 1.0f, 16.0f)};
}

uint32_t Architecture::levels() const { return static_cast<uint32_t>(std::countr_zero(scale)); }

ChannelKind kind_of(std::string_view layer) {
  return layer == "albedo"     ? ChannelKind::kAlbedo
         : layer == "normal"   ? ChannelKind::kNormal
         : layer == "variance" ? ChannelKind::kVariance
                               : ChannelKind::kRadiance;
}

}  // namespace raymeld
