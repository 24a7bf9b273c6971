#pragma once

#include <array>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raymeld {

// Lists the layers that a model may ask for; each has three channels.
inline constexpr std::array<std::string_view, 6> kLayerNames = {"color",   "albedo",   "normal",
                                                                "diffuse", "specular", "variance"};

// Names three channels of a file; a grey channel is named three times.
using ChannelTriple = std::array<std::string, 3>;

enum class LayerRule {
  kRead,       // terms: the layer
  kEquation2,  // terms: colour, direct, indirect; colour * (direct + indirect) (Hou et al. 2021, Eq. 2)
  kSum,        // terms: direct, indirect
  kVariance,   // terms: colour; the layer is its variance_3x3()
};

struct LayerSource {
  LayerRule rule = LayerRule::kRead;
  std::vector<ChannelTriple> terms;
  std::string note;  // the reason why this source is second best; empty for the best
};

// Names the two channels that lead from a pixel to the same point in the last frame. Times their factors they
// are pixels to the right and downwards.
struct MotionSource {
  std::array<std::string, 2> channels;
  std::array<float, 2> factors = {1, 1};
};

// Holds the user's choices; everything left empty is found automatically.
struct LayerChoice {
  std::string preset;      // cycles, pbrt, arnold, renderman or generic
  std::string view_layer;  // Blender's `Layer` in `Layer.Pass.View.Channel`
  std::string view;
  // Maps a layer to a prefix, a channel or three channels separated by commas, "alpha" and "depth" to a
  // channel, and "motion" to a prefix or two channels.
  std::map<std::string, std::string> overrides;
  std::optional<std::array<float, 2>> motion_factors = {};  // instead of those of the preset
};

struct LayerMap {
  std::string preset;
  std::string view_layer;
  std::string view;
  std::map<std::string, LayerSource> layers;      // only the layers that were found
  std::map<std::string, std::string> looked_for;  // the names tried for each layer, for messages
  std::optional<std::string> alpha;               // the channel that belongs to color
  std::optional<MotionSource> motion = {};
  std::optional<std::string> depth = {};  // the channel; it matters beside motion
  std::vector<std::string> others = {};   // options for other view layers and views with a color
  std::string has = {};                   // the groups of channels in the file, for messages
};

// Reads `cycles`, `viewlayer=NAME`, `view=NAME`, `albedo=PREFIX`, `albedo=CHANNEL,CHANNEL,CHANNEL`,
// `alpha=CHANNEL`, `depth=CHANNEL`, `motion=PREFIX`, `motion=CHANNEL,CHANNEL` and `motion-factors=X,Y`.
// Throws Error, naming the item.
LayerChoice parse_layer_choice(std::span<const std::string> items);

// Finds the layers among the channels of a file. Takes the preset, view layer and view that give a color and
// the most layers, motion among them, and the first of equals. Throws Error if an override or a chosen name
// is not in the file.
LayerMap map_layers(std::span<const std::string> channel_names, const LayerChoice& choice = {});

// Returns a text that says for each layer, in a line of its own, which channels it comes from.
std::string layer_map_text(const LayerMap& map);

// Throws an Error that names the file, every layer in `wanted` that `map` lacks, and the channels looked for.
void require_layers(const LayerMap& map, std::span<const std::string> wanted, const std::string& file);

// Returns a text like that for a file without motion vectors.
std::string no_motion_text(const LayerMap& map, const std::string& file);

}  // namespace raymeld
