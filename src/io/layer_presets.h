#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/layer_map.h"

namespace raymeld {

// Describes one way to get a layer. Each term lists the pass names that fit, best first; "" is the file's
// unnamed R, G, B.
struct LayerRecipe {
  std::string_view layer;
  LayerRule rule;
  std::vector<std::vector<std::string_view>> terms;
  std::string_view note = {};  // the reason why the recipe is second best
  bool in_any_scope = false;   // the unnamed R, G, B stand in for those of every view layer and view
};

// Returns texts for messages: every pass that fits by itself or, for a rule of several terms, one text such
// as `(DiffCol | Diffuse Color) * ((DiffDir | ...) + (DiffInd | ...))`.
std::vector<std::string> recipe_texts(const LayerRecipe& recipe);

// Says how one renderer names its motion vectors. The factors make them lead to the last frame's pixel, to
// the right and downwards.
struct MotionRecipe {
  std::vector<std::string_view> passes;  // those that fit, best first
  std::array<float, 2> factors = {1, 1};
  std::vector<std::string_view> depths = {};  // passes of one channel, best first
};

// Says how one renderer names its passes. The first of a layer's recipes that the file can fulfil counts.
struct LayerPreset {
  std::string_view name;
  std::vector<LayerRecipe> recipes;
  MotionRecipe motion = {};
};

// Lists every preset. An earlier preset wins a tie.
std::span<const LayerPreset> layer_presets();

}  // namespace raymeld
