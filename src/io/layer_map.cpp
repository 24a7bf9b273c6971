#include "io/layer_map.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "error.h"
#include "io/channel_groups.h"
#include "io/layer_presets.h"
#include "io/layer_scope.h"

namespace raymeld {
namespace {

// Returns the prefix of a pass in this scope. The unnamed R, G, B belong to no view layer, and have a prefix
// there only if the recipe lets them stand in.
std::optional<std::string> prefix_in(const Scope& scope, std::string_view pass, const LayerRecipe& recipe) {
  if (!pass.empty()) return prefix_of(scope, pass);
  return scope == Scope{} || recipe.in_any_scope ? std::optional<std::string>("") : std::nullopt;
}

std::optional<LayerSource> follow(const LayerRecipe& recipe, const Scope& scope,
                                  const ChannelGroups& groups) {
  LayerSource source{recipe.rule, {}, std::string(recipe.note)};
  for (const auto& passes : recipe.terms) {
    std::optional<ChannelTriple> term;
    for (std::string_view pass : passes)
      if (const auto prefix = prefix_in(scope, pass, recipe); prefix && !term) term = groups.triple(*prefix);
    if (!term) return std::nullopt;
    source.terms.push_back(*term);
  }
  return source;
}

std::optional<std::string> find_alpha(const LayerPreset& preset, const Scope& scope,
                                      const ChannelGroups& groups) {
  for (const LayerRecipe& recipe : preset.recipes) {
    if (recipe.layer != "color" || !follow(recipe, scope, groups)) continue;
    for (std::string_view pass : recipe.terms.front())
      if (const auto prefix = prefix_in(scope, pass, recipe); prefix && groups.alpha(*prefix))
        return groups.alpha(*prefix);
    return std::nullopt;
  }
  return std::nullopt;
}

std::optional<MotionSource> find_motion(const LayerPreset& preset, const Scope& scope,
                                        const ChannelGroups& groups) {
  for (std::string_view pass : preset.motion.passes)
    if (const auto pair = groups.pair(prefix_of(scope, pass)))
      return MotionSource{*pair, preset.motion.factors};
  return std::nullopt;
}

std::optional<std::string> find_depth(const LayerPreset& preset, const Scope& scope,
                                      const ChannelGroups& groups) {
  for (std::string_view pass : preset.motion.depths)
    if (const auto channel = groups.depth(prefix_of(scope, pass))) return channel;
  return std::nullopt;
}

LayerMap apply(const LayerPreset& preset, const Scope& scope, const ChannelGroups& groups) {
  LayerMap map{std::string(preset.name),
               scope.view_layer,
               scope.view,
               {},
               {},
               find_alpha(preset, scope, groups),
               find_motion(preset, scope, groups),
               find_depth(preset, scope, groups)};
  for (const LayerRecipe& recipe : preset.recipes) {
    const std::string layer(recipe.layer);
    if (map.layers.contains(layer)) continue;
    if (auto source = follow(recipe, scope, groups)) map.layers[layer] = *source;
  }
  return map;
}

// Takes a group of any name as the color if no other group in the file has three channels.
void take_only_rgb(const ChannelGroups& groups, LayerMap& map) {
  std::vector<std::string> prefixes;
  for (const std::string& prefix : groups.prefixes())
    if (groups.triple(prefix)) prefixes.push_back(prefix);
  if (prefixes.size() != 1) return;
  map.layers["color"] = {
      LayerRule::kRead, {*groups.triple(prefixes.front())}, "the only colours in the file"};
  map.alpha = groups.alpha(prefixes.front());
}

std::vector<const LayerPreset*> chosen_presets(const LayerChoice& choice) {
  std::vector<const LayerPreset*> presets;
  std::vector<std::string_view> names;
  for (const LayerPreset& preset : layer_presets()) {
    if (choice.preset.empty() || choice.preset == preset.name) presets.push_back(&preset);
    names.push_back(preset.name);
  }
  if (presets.empty())
    throw Error("there is no preset '{}' for layers; there are {}", choice.preset, fmt::join(names, ", "));
  return presets;
}

[[noreturn]] void throw_no_scope(const LayerChoice& choice, const std::vector<Scope>& scopes) {
  std::vector<std::string> names;
  for (const Scope& scope : scopes)
    if (scope != Scope{}) names.push_back(fmt::format("'{}' (view '{}')", scope.view_layer, scope.view));
  throw Error("there is no view layer '{}' with the view '{}'; there are {}", choice.view_layer, choice.view,
              names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", ")));
}

// Returns the options that choose the map's view layer and view.
std::string scope_text(const LayerMap& map) {
  std::vector<std::string> options;
  if (!map.view_layer.empty()) options.push_back(fmt::format("--map viewlayer={}", map.view_layer));
  if (!map.view.empty()) options.push_back(fmt::format("--map view={}", map.view));
  return fmt::format("{}", fmt::join(options, " "));
}

std::pair<bool, size_t> worth(const LayerMap& map) {
  return {map.layers.contains("color"), map.layers.size() + size_t(map.motion.has_value())};
}

// Lists the options for view layers and views whose color differs from the best map's, one for each color.
std::vector<std::string> others_than(const LayerMap& best, const std::vector<LayerMap>& maps) {
  std::set<std::string> colors;
  if (best.layers.contains("color")) colors.insert(best.layers.at("color").terms[0][0]);
  std::vector<std::string> others;
  for (const LayerMap& map : maps) {
    const bool has_scope = !map.view_layer.empty() || !map.view.empty();
    if (has_scope && map.layers.contains("color") && colors.insert(map.layers.at("color").terms[0][0]).second)
      others.push_back(scope_text(map));
  }
  return others;
}

LayerMap best_map(const ChannelGroups& groups, const LayerChoice& choice) {
  std::vector<LayerMap> maps;
  std::vector<Scope> refused;
  for (const LayerPreset* preset : chosen_presets(choice)) {
    for (const Scope& scope : scopes_of(*preset, groups)) {
      const bool is_wanted = (choice.view_layer.empty() || choice.view_layer == scope.view_layer) &&
                             (choice.view.empty() || choice.view == scope.view);
      if (is_wanted) {
        maps.push_back(apply(*preset, scope, groups));
      } else {
        refused.push_back(scope);
      }
    }
  }
  if (maps.empty()) throw_no_scope(choice, refused);
  LayerMap best = *std::ranges::max_element(maps, {}, worth);
  best.others = others_than(best, maps);
  return best;
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  size_t begin = 0;
  for (size_t end; (end = text.find(separator, begin)) != std::string::npos; begin = end + 1)
    parts.push_back(text.substr(begin, end - begin));
  parts.push_back(text.substr(begin));
  return parts;
}

ChannelTriple overridden(const std::string& layer, const std::string& value, const ChannelGroups& groups) {
  if (const auto triple = groups.triple(value)) return *triple;
  if (groups.has_channel(value)) return {value, value, value};
  const std::vector<std::string> names = split(value, ',');
  if (names.size() != 3)
    throw Error(
        "cannot map layer '{}' to '{}': there are no channels {}.R, .G, .B or {}.X, .Y, .Z; "
        "expected a prefix, a channel or three channels separated by commas",
        layer, value, value, value);
  for (const std::string& name : names)
    if (!groups.has_channel(name))
      throw Error("cannot map layer '{}': there is no channel '{}'", layer, name);
  return {names[0], names[1], names[2]};
}

// Returns the channels of motion that the user names; their factors are 1.
MotionSource overridden_motion(const std::string& value, const ChannelGroups& groups) {
  if (const auto pair = groups.pair(value)) return {*pair};
  const std::vector<std::string> names = split(value, ',');
  if (names.size() != 2)
    throw Error(
        "cannot map motion to '{0}': there are no channels {0}.X, .Y, {0}.U, .V or {0}.R, .G; expected a "
        "prefix or two channels separated by a comma",
        value);
  for (const std::string& name : names)
    if (!groups.has_channel(name)) throw Error("cannot map motion: there is no channel '{}'", name);
  return {{names[0], names[1]}};
}

void apply_overrides(const LayerChoice& choice, const ChannelGroups& groups, LayerMap& map) {
  for (const auto& [layer, value] : choice.overrides) {
    if (layer == "motion") {
      map.motion = overridden_motion(value, groups);
    } else if (layer != "alpha" && layer != "depth") {
      map.layers[layer] = {LayerRule::kRead, {overridden(layer, value, groups)}, ""};
      if (layer == "color") map.alpha = groups.alpha(value), map.others.clear();
    }
  }
  if (map.motion && choice.motion_factors) map.motion->factors = *choice.motion_factors;
  for (const auto& [name, channel] : {std::pair("alpha", &map.alpha), {"depth", &map.depth}}) {
    const auto found = choice.overrides.find(name);
    if (found == choice.overrides.end()) continue;
    if (!groups.has_channel(found->second))
      throw Error("cannot map {}: there is no channel '{}'", name, found->second);
    *channel = found->second;
  }
}

std::map<std::string, std::string> looked_for(const LayerChoice& choice, const ChannelGroups& groups) {
  std::map<std::string, std::vector<std::string>> texts;
  for (const LayerPreset* preset : chosen_presets(choice))
    for (const LayerRecipe& recipe : preset->recipes)
      for (const std::string& text : recipe_texts(recipe))
        if (auto& known = texts[std::string(recipe.layer)]; std::ranges::find(known, text) == known.end())
          known.push_back(text);
  for (const LayerPreset* preset : chosen_presets(choice))
    for (std::string_view pass : preset->motion.passes) texts["motion"].emplace_back(pass);
  std::map<std::string, std::string> joined;
  for (const auto& [layer, of_layer] : texts) joined[layer] = fmt::format("{}", fmt::join(of_layer, " | "));
  if (groups.is_luminance_chroma(""))
    joined["color"] +=
        "; the file's luminance and chroma, Y, RY and BY, must be converted to R, G and B first";
  return joined;
}

// Lists the groups of channels that could be a layer, as --map names them.
std::string groups_text(const ChannelGroups& groups) {
  std::vector<std::string> texts;
  for (const std::string& prefix : groups.prefixes()) {
    if (const auto triple = groups.triple(prefix))
      texts.push_back(prefix.empty() ? fmt::format("{}", fmt::join(*triple, ",")) : prefix);
  }
  return texts.empty() ? "no group of three channels" : fmt::format("{}", fmt::join(texts, ", "));
}

}  // namespace

LayerMap map_layers(std::span<const std::string> channel_names, const LayerChoice& choice) {
  const ChannelGroups groups(channel_names);
  LayerMap map = best_map(groups, choice);
  if (!map.layers.contains("color") && choice.view_layer.empty() && choice.view.empty())
    take_only_rgb(groups, map);
  apply_overrides(choice, groups, map);
  const auto color = map.layers.find("color");
  if (color != map.layers.end() && !map.layers.contains("variance"))
    map.layers["variance"] = {LayerRule::kVariance, color->second.terms, "the file has no variance"};
  map.looked_for = looked_for(choice, groups);
  map.has = groups_text(groups);
  return map;
}

}  // namespace raymeld
