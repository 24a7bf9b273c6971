// Reads the metadata of a model's file: what all networks have, and what those have that read HRLS.
#include <algorithm>
#include <array>
#include <bit>
#include <set>
#include <span>

#include "io/layer_map.h"
#include "networks/builder.h"
#include "networks/entries.h"

namespace raymeld {
namespace {

using Metadata = std::map<std::string, std::string>;

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

// Sets lrhs_centered and both_samplings.
void parse_sampling(const Entries& entries, Architecture& a) {
  const std::vector<std::string> samplings = entries.list("lrhs_sampling");
  if (samplings.empty() || !are_among(samplings, std::array<std::string_view, 2>{"nearest", "centered"})) {
    entries.reject("lrhs_sampling", "nearest, centered or both, the default first");
  }
  a.lrhs_centered = samplings.front() == "centered";
  a.both_samplings = samplings.size() == 2;
}

void parse_hrls(const Entries& entries, Architecture& a) {
  a.hrls_layers = hrls_layers(entries);
  a.optional_layers = optional_layers(entries, a.hrls_layers);
  a.knows_spp = entries.has("knows_spp") && entries.choice("knows_spp", "true", "false");
  if (!a.reads_lrhs()) return;
  parse_sampling(entries, a);
}

// Returns the network that the entry names. Models from before there was a choice have no entry.
NetworkKind network_kind(const Entries& entries) {
  if (!entries.has("network")) return NetworkKind::kFusion;
  std::vector<std::string> names;
  for (const NetworkKind kind : kNetworkKinds) {
    names.push_back(fmt::format("\"{}\"", functions_of(kind).name));
    if (entries.text("network") == functions_of(kind).name) return kind;
  }
  entries.reject("network", fmt::format("one of {}", fmt::join(names, ", ")));
}

}  // namespace

Architecture parse_architecture(const Metadata& metadata, const std::string& file) {
  const Entries entries(metadata, file);
  if (entries.text("format") != "raymeld.model") entries.reject("format", "\"raymeld.model\"");
  if (entries.text("format_version") != "1") entries.reject("format_version", "\"1\"");
  Architecture a;
  a.kind = network_kind(entries);
  const NetworkFunctions& network = functions_of(a.kind);
  if (network.most_scale == 1 && entries.text("scale") != "1")
    entries.reject("scale", "1, as the network denoises");
  a.scale = entries.integer("scale", network.least_scale, network.most_scale);
  if (!std::has_single_bit(a.scale))
    entries.reject("scale", network.least_scale == 1 ? "1, 2, 4 or 8" : "2, 4 or 8");
  a.transfer = entries.choice("transfer", "log", "linear") ? Transfer::kLog : Transfer::kLinear;
  a.clip = entries.number("clip", false);
  a.exposure_key = entries.number("exposure_key", true);
  if (a.reads_hrls()) parse_hrls(entries, a);
  network.parse(entries, a);
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
