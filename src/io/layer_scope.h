#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "io/channel_groups.h"
#include "io/layer_presets.h"

namespace raymeld {

// Blender's `Layer.Pass.View`: the layer and view that one picture's passes share. Both may be empty.
struct Scope {
  std::string view_layer;
  std::string view;
  bool operator==(const Scope&) const = default;
};

// `view_layer.pass.view`, without the empty ones.
std::string prefix_of(const Scope& scope, std::string_view pass);

// The unnamed scope, then every one in which the file has a pass of the preset, in the order of the file.
std::vector<Scope> scopes_of(const LayerPreset& preset, const ChannelGroups& groups);

}  // namespace raymeld
