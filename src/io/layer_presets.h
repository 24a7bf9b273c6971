#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/layer_map.h"

namespace raymeld {

// One way to get a layer. Each term lists the pass names that will do, best first; "" is the file's unnamed
// R, G, B.
struct LayerRecipe {
  std::string_view layer;
  LayerRule rule;
  std::vector<std::vector<std::string_view>> terms;
  std::string_view note = {};  // why it is second best
  bool in_any_scope = false;   // the unnamed R, G, B stand in for those of every view layer and view
};

// For messages: every pass that will do by itself, or the one text of a rule of several terms,
// `(DiffCol | Diffuse Color) * ((DiffDir | ...) + (DiffInd | ...))`.
std::vector<std::string> recipe_texts(const LayerRecipe& recipe);

// How one renderer names its passes. Of several recipes for a layer the first that the file can fulfil
// counts.
struct LayerPreset {
  std::string_view name;
  std::vector<LayerRecipe> recipes;
};

// Every preset, in the order in which ties are decided.
std::span<const LayerPreset> layer_presets();

}  // namespace raymeld
