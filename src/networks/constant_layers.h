// Handles layers of HRLS that have one value everywhere, such as layers that a render lacks. No image holds
// them; their encoded values are written beside the layers of the image.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "io/image.h"
#include "networks/model.h"

namespace raymeld {

// Maps a layer's name to the encoded values of its three channels (layers.h: encode), which are 0 for a layer
// that a render lacks.
using ConstantLayers = std::map<std::string, std::array<float, 3>>;

// Throws Error unless these are layers of the model other than the color and in range: albedo in [0, 1],
// normals in [-1, 1], and 0 for layers that the exposure changes.
void check_constant_layers(const Model& model, const ConstantLayers& constants);

// Lists the layers that an HRLS image holds, three channels each: the model's layers in its order, without
// the constant ones. With `compute_variance` it does not hold the variance either, which the device computes
// from the color.
std::vector<std::string> image_layers(const Architecture& architecture, const ConstantLayers& constants,
                                      bool compute_variance = false);

// Moves the layers of an HRLS image that are encoded as one value at any exposure to `constants`, which lists
// the layers that the image does not hold.
void take_constant_layers(const Architecture& architecture, Image& hrls, ConstantLayers& constants);

// Describes the channels of encoded HRLS in network().
struct HrlsChannels {
  std::vector<EncodedChannel> encoded;
  std::optional<uint32_t> variance = {};  // the first of the three channels that variance() writes, if any
  std::map<std::string, uint32_t> first;  // each layer's first channel in `encoded`
};
HrlsChannels hrls_channels(const Architecture& architecture, const ConstantLayers& constants,
                           bool compute_variance = false);

}  // namespace raymeld
