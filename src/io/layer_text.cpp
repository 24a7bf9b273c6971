#include <fmt/ranges.h>

#include <algorithm>

#include "error.h"
#include "io/layer_map.h"
#include "io/layer_presets.h"

namespace raymeld {
namespace {

bool is_layer(std::string_view name) { return std::ranges::find(kLayerNames, name) != kLayerNames.end(); }

std::string source_text(const LayerSource& source) {
  std::vector<std::string> terms;
  for (const ChannelTriple& term : source.terms)
    terms.push_back(term[0] == term[2] ? term[0] : fmt::format("{}", fmt::join(term, ", ")));
  switch (source.rule) {
    case LayerRule::kRead:
      return terms[0];
    case LayerRule::kEquation2:
      return fmt::format("({}) * (({}) + ({}))", terms[0], terms[1], terms[2]);
    case LayerRule::kSum:
      return fmt::format("({}) + ({})", terms[0], terms[1]);
    case LayerRule::kVariance:
      return fmt::format("3x3 variance of ({})", terms[0]);
  }
  return {};
}

}  // namespace

std::vector<std::string> recipe_texts(const LayerRecipe& recipe) {
  if (recipe.terms.size() == 1) {
    std::vector<std::string> names(recipe.terms[0].begin(), recipe.terms[0].end());
    std::ranges::replace(names, std::string(), std::string("plain R, G, B"));
    return names;
  }
  std::vector<std::string> terms;
  for (const auto& passes : recipe.terms) {
    const std::string names = fmt::format("{}", fmt::join(passes, " | "));
    terms.push_back(passes.size() > 1 ? fmt::format("({})", names) : names);
  }
  if (recipe.rule == LayerRule::kEquation2)
    return {fmt::format("{} * ({} + {})", terms[0], terms[1], terms[2])};
  return {fmt::format("({})", fmt::join(terms, " + "))};
}

LayerChoice parse_layer_choice(std::span<const std::string> items) {
  LayerChoice choice;
  for (const std::string& item : items) {
    const size_t equals = item.find('=');
    const std::string key = item.substr(0, equals);
    const std::string value = equals == std::string::npos ? "" : item.substr(equals + 1);
    if (equals != std::string::npos && value.empty())
      throw Error("cannot map layers by '{}': expected a value after the =", item);
    if (equals == std::string::npos)
      choice.preset = item;
    else if (key == "viewlayer")
      choice.view_layer = value;
    else if (key == "view")
      choice.view = value;
    else if (key == "alpha" || is_layer(key))
      choice.overrides[key] = value;
    else
      throw Error("cannot map layers by '{}': there is no layer '{}'; there are alpha, {}", item, key,
                  fmt::join(kLayerNames, ", "));
  }
  return choice;
}

std::string layer_map_text(const LayerMap& map) {
  std::string text = fmt::format("preset {}", map.preset);
  if (!map.view_layer.empty()) text += fmt::format(", view layer '{}'", map.view_layer);
  if (!map.view.empty()) text += fmt::format(", view '{}'", map.view);
  for (std::string_view layer : kLayerNames) {
    const auto found = map.layers.find(std::string(layer));
    text += fmt::format("\n  {:<8} ", layer);
    text += found == map.layers.end() ? "-" : source_text(found->second);
    if (found != map.layers.end() && !found->second.note.empty())
      text += fmt::format("  [{}]", found->second.note);
  }
  return text + fmt::format("\n  {:<8} {}\n", "alpha", map.alpha.value_or("-"));
}

void require_layers(const LayerMap& map, std::span<const std::string> wanted, const std::string& file) {
  std::string missing;
  for (const std::string& layer : wanted) {
    if (!is_layer(layer))
      throw Error("there is no layer '{}'; there are {}", layer, fmt::join(kLayerNames, ", "));
    if (map.layers.contains(layer)) continue;
    const auto looked_for = map.looked_for.find(layer);
    missing += fmt::format("\n  {}: looked for {}", layer,
                           looked_for == map.looked_for.end() ? "nothing, as the preset has no name for it"
                                                              : looked_for->second);
  }
  if (!missing.empty())
    throw Error("'{}' lacks layers that are needed (preset {}):{}\n  the file has: {}", file, map.preset,
                missing, map.has);
}

}  // namespace raymeld
