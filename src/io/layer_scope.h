#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "io/channel_groups.h"
#include "io/layer_presets.h"

namespace raymeld {

// Holds the layer and view of Blender's `Layer.Pass.View` that a picture's passes share. Both may be empty.
struct Scope {
  std::string view_layer;
  std::string view;
  bool operator==(const Scope&) const = default;
};

// Returns `view_layer.pass.view`, without its empty parts.
std::string prefix_of(const Scope& scope, std::string_view pass);

// Lists the unnamed scope, then every scope in which the file has a pass of the preset, in file order.
std::vector<Scope> scopes_of(const LayerPreset& preset, const ChannelGroups& groups);

}  // namespace raymeld
