#pragma once

#include <array>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raymeld {

// The layers that a model may ask for, three channels each.
inline constexpr std::array<std::string_view, 6> kLayerNames = {"color",   "albedo",   "normal",
                                                                "diffuse", "specular", "variance"};

// Three channels of a file; a grey one stands three times.
using ChannelTriple = std::array<std::string, 3>;

enum class LayerRule {
  kRead,       // terms: the layer
  kEquation2,  // terms: colour, direct, indirect; colour * (direct + indirect) (Hou et al. 2021, Eq. 2)
  kSum,        // terms: direct, indirect
  kVariance,   // terms: colour; variance_3x3() of it
};

struct LayerSource {
  LayerRule rule = LayerRule::kRead;
  std::vector<ChannelTriple> terms;
  std::string note;  // why this source is second best; empty when it is not
};

// What the user chose; everything left empty is found automatically.
struct LayerChoice {
  std::string preset;      // cycles, pbrt, arnold, renderman or generic
  std::string view_layer;  // Blender's `Layer` in `Layer.Pass.View.Channel`
  std::string view;
  std::map<std::string, std::string>
      overrides;  // by layer, or "alpha": a prefix, or three channels by commas
};

struct LayerMap {
  std::string preset;
  std::string view_layer;
  std::string view;
  std::map<std::string, LayerSource> layers;      // only what was found
  std::map<std::string, std::string> looked_for;  // per layer, for messages
  std::optional<std::string> alpha;               // the channel that belongs to color
  std::vector<std::string> others = {};           // options for other view layers and views with a color
  std::string has = {};                           // the groups of channels in the file, for messages
};

// Reads `cycles`, `viewlayer=NAME`, `view=NAME`, `albedo=PREFIX`, `albedo=CHANNEL,CHANNEL,CHANNEL` and
// `alpha=CHANNEL`. Throws Error, naming the item.
LayerChoice parse_layer_choice(std::span<const std::string> items);

// Finds the layers among the channels of one file. Of several presets, view layers and views the one that
// gives a color and the most layers is taken, the first of equals. Throws Error when an override or a chosen
// name is not in the file.
LayerMap map_layers(std::span<const std::string> channel_names, const LayerChoice& choice = {});

// One line per layer: where it comes from.
std::string describe(const LayerMap& map);

// Throws Error naming the file, every layer in `wanted` that `map` lacks, and the channels looked for.
void require_layers(const LayerMap& map, std::span<const std::string> wanted, const std::string& file);

}  // namespace raymeld
