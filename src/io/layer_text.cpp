#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>

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

// Reads two numbers that are separated by a comma. Throws Error.
std::array<float, 2> parse_factors(const std::string& item, const std::string& text) {
  std::array<float, 2> factors{};
  const char* const end = text.data() + text.size();
  const auto first = std::from_chars(text.data(), end, factors[0]);
  const bool has_comma = first.ec == std::errc() && first.ptr != end && *first.ptr == ',';
  const auto second = std::from_chars(has_comma ? first.ptr + 1 : end, end, factors[1]);
  if (second.ec != std::errc() || second.ptr != end || !std::isfinite(factors[0]) ||
      !std::isfinite(factors[1]))
    throw Error("cannot map layers by '{}': expected two factors such as 1,-1", item);
  return factors;
}

// Returns the names that were tried for a layer.
std::string looked_for_text(const LayerMap& map, const std::string& layer) {
  const auto found = map.looked_for.find(layer);
  return found == map.looked_for.end() ? "nothing, as the preset has no name for it" : found->second;
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
    else if (key == "motion-factors")
      choice.motion_factors = parse_factors(item, value);
    else if (key == "alpha" || key == "depth" || key == "motion" || is_layer(key))
      choice.overrides[key] = value;
    else
      throw Error("cannot map layers by '{}': there is no layer '{}'; there are alpha, depth, motion, {}",
                  item, key, fmt::join(kLayerNames, ", "));
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
  text += fmt::format("\n  {:<8} {}", "alpha", map.alpha.value_or("-"));
  if (map.motion)
    text += fmt::format("\n  {:<8} {}, times {:g}, {:g}", "motion", fmt::join(map.motion->channels, ", "),
                        map.motion->factors[0], map.motion->factors[1]);
  if (map.motion) text += fmt::format("\n  {:<8} {}", "depth", map.depth.value_or("-"));
  return text + '\n';
}

void require_layers(const LayerMap& map, std::span<const std::string> wanted, const std::string& file) {
  std::string missing;
  for (const std::string& layer : wanted) {
    if (!is_layer(layer))
      throw Error("there is no layer '{}'; there are {}", layer, fmt::join(kLayerNames, ", "));
    if (map.layers.contains(layer)) continue;
    missing += fmt::format("\n  {}: looked for {}", layer, looked_for_text(map, layer));
  }
  if (!missing.empty())
    throw Error("'{}' lacks layers that are needed (preset {}):{}\n  the file has: {}", file, map.preset,
                missing, map.has);
}

std::string no_motion_text(const LayerMap& map, const std::string& file) {
  return fmt::format("'{}' has no motion vectors (preset {}): looked for {}\n  the file has: {}", file,
                     map.preset, looked_for_text(map, "motion"), map.has);
}

}  // namespace raymeld
