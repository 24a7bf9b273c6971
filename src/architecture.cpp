// The metadata of a model's file: docs/model-format.md lists the entries.
#include <bit>
#include <charconv>
#include <cmath>
#include <set>

#include "io/layer_map.h"
#include "model.h"

namespace raymeld {
namespace {

using Metadata = std::map<std::string, std::string>;

class Entries {
 public:
  Entries(const Metadata& metadata, const std::string& file) : metadata_(metadata), file_(file) {}

  const std::string& text(const std::string& key) const {
    const auto found = metadata_.find(key);
    if (found == metadata_.end()) throw Error("model {}: metadata entry \"{}\" is missing", file_, key);
    return found->second;
  }

  uint32_t integer(const std::string& key, uint32_t most) const {
    const std::string& value = text(key);
    uint32_t number = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
    if (error != std::errc() || end != value.data() + value.size() || number < 1 || number > most) {
      reject(key, fmt::format("an integer from 1 to {}", most));
    }
    return number;
  }

  float positive(const std::string& key) const {
    const std::string& value = text(key);
    float number = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
    if (error != std::errc() || end != value.data() + value.size() || !std::isfinite(number) || number <= 0) {
      reject(key, "a positive number");
    }
    return number;
  }

  // Whether the entry is `yes`; it must be `yes` or `no`.
  bool choice(const std::string& key, const std::string& yes, const std::string& no) const {
    const std::string& value = text(key);
    if (value != yes && value != no) reject(key, fmt::format("\"{}\" or \"{}\"", yes, no));
    return value == yes;
  }

  [[noreturn]] void reject(const std::string& key, const std::string& expected) const {
    throw Error("model {}: metadata entry \"{}\" is \"{}\", expected {}", file_, key, text(key), expected);
  }

 private:
  const Metadata& metadata_;
  const std::string& file_;
};

std::vector<std::string> split_layers(const Entries& entries) {
  const std::string expected = fmt::format("color, then any of {}, each once", fmt::join(kLayerNames, ", "));
  const std::string& list = entries.text("hrls_layers");
  std::vector<std::string> layers;
  for (size_t begin = 0; begin <= list.size();) {
    const size_t end = std::min(list.find(',', begin), list.size());
    layers.push_back(list.substr(begin, end - begin));
    begin = end + 1;
  }
  const std::set<std::string_view> known(kLayerNames.begin(), kLayerNames.end());
  for (const std::string& layer : layers) {
    if (!known.contains(layer)) entries.reject("hrls_layers", expected);
  }
  if (layers.front() != "color" || std::set(layers.begin(), layers.end()).size() != layers.size()) {
    entries.reject("hrls_layers", expected);
  }
  return layers;
}

}  // namespace

Architecture parse_architecture(const Metadata& metadata, const std::string& file) {
  const Entries entries(metadata, file);
  if (entries.text("format") != "raymeld.model") entries.reject("format", "\"raymeld.model\"");
  if (entries.text("format_version") != "1") entries.reject("format_version", "\"1\"");
  constexpr uint32_t kMostChannels = 1024, kMostRepeats = 64;
  Architecture a;
  a.scale = entries.integer("scale", 8);
  if (a.scale != 2 && a.scale != 4 && a.scale != 8) entries.reject("scale", "2, 4 or 8");
  a.features = entries.integer("features", kMostChannels);
  a.growth = entries.integer("growth", kMostChannels);
  a.dense_layers = entries.integer("dense_layers", kMostRepeats);
  a.blocks = entries.integer("blocks", kMostRepeats);
  a.groups = entries.integer("groups", kMostRepeats);
  a.hrls_layers = split_layers(entries);
  a.long_skip = entries.choice("long_skip", "lrhs", "fused") ? LongSkip::kLrhs : LongSkip::kFused;
  a.merge_relu = entries.choice("merge_relu", "true", "false");
  a.transfer = entries.choice("transfer", "log", "linear") ? Transfer::kLog : Transfer::kLinear;
  a.clip = entries.positive("clip");
  a.bilinear_base = entries.choice("base", "bilinear", "none");
  a.lrhs_centered = entries.choice("lrhs_sampling", "centered", "nearest");
  return a;
}

uint32_t Architecture::levels() const { return static_cast<uint32_t>(std::countr_zero(scale)); }

std::vector<ChannelKind> Architecture::hrls_kinds() const {
  std::vector<ChannelKind> kinds;
  for (const std::string& layer : hrls_layers) {
    const ChannelKind kind = layer == "albedo"   ? ChannelKind::kAlbedo
                             : layer == "normal" ? ChannelKind::kNormal
                                                 : ChannelKind::kRadiance;
    kinds.insert(kinds.end(), 3, kind);
  }
  return kinds;
}

}  // namespace raymeld
