#include "io/layer_scope.h"

#include <algorithm>
#include <optional>

namespace raymeld {
namespace {

// Returns the view layer in front of `pass` if `prefix` ends in `pass`, else nothing.
std::optional<std::string> view_layer_of(std::string_view prefix, std::string_view pass) {
  if (prefix == pass) return "";
  if (!prefix.ends_with(pass)) return std::nullopt;
  prefix.remove_suffix(pass.size());
  if (!prefix.ends_with('.')) return std::nullopt;
  return std::string(prefix.substr(0, prefix.size() - 1));
}

void add_scopes(const std::string& prefix, std::string_view pass, std::vector<Scope>& scopes) {
  const auto add = [&](const Scope& scope) {
    if (std::ranges::find(scopes, scope) == scopes.end()) scopes.push_back(scope);
  };
  if (const auto view_layer = view_layer_of(prefix, pass)) add({*view_layer, ""});
  const size_t dot = prefix.rfind('.');
  if (dot == std::string::npos) return;
  if (const auto view_layer = view_layer_of(prefix.substr(0, dot), pass))
    add({*view_layer, prefix.substr(dot + 1)});
}

}  // namespace

std::string prefix_of(const Scope& scope, std::string_view pass) {
  std::string prefix = scope.view_layer;
  for (std::string_view part : {pass, std::string_view(scope.view)}) {
    if (!prefix.empty() && !part.empty()) prefix += '.';
    prefix += part;
  }
  return prefix;
}

std::vector<Scope> scopes_of(const LayerPreset& preset, const ChannelGroups& groups) {
  std::vector<Scope> scopes = {{}};
  for (const std::string& prefix : groups.prefixes()) {
    for (std::string_view pass : preset.motion.passes) add_scopes(prefix, pass, scopes);
    for (const LayerRecipe& recipe : preset.recipes)
      for (const auto& passes : recipe.terms)
        for (std::string_view pass : passes)
          if (!pass.empty()) add_scopes(prefix, pass, scopes);
  }
  return scopes;
}

}  // namespace raymeld
