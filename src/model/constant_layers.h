// Layers of HRLS that are one value everywhere, as those are that a render does not have: no image holds them
// and no convolution reads them.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "io/image.h"
#include "model/model.h"

namespace raymeld {

// By the layer's name, what the network reads in its three channels (layers.h: encode): 0 of a layer that a
// render does not have.
using ConstantLayers = std::map<std::string, std::array<float, 3>>;

// Throws Error unless these are layers of the model's but the colour, within their range: albedo in [0, 1],
// normals in [-1, 1], and all that the exposure changes 0.
void check_constant_layers(const Model& model, const ConstantLayers& constants);

// The layers that an HRLS image holds, three channels each: the model's without these, in its order.
// `compute_variance`: nor does it hold the variance, which the device computes of the color.
std::vector<std::string> image_layers(const Architecture& architecture, const ConstantLayers& constants,
                                      bool compute_variance = false);

// Moves the layers of an HRLS image that are constant, once encoded with whatever exposure, to `constants`,
// which are the layers that the image does not hold.
void take_constant_layers(const Architecture& architecture, Image& hrls, ConstantLayers& constants);

// How network() keeps HRLS: the layers of the image, and in front of them constant ones that the joint base
// reads, where no convolution does.
struct HrlsChannels {
  std::vector<EncodedChannel> encoded;
  uint32_t unread = 0;                    // of them, in front: by convolutions
  std::optional<uint32_t> variance = {};  // the first of the three among them that variance() makes, if any
  std::map<std::string, uint32_t> first;  // of a layer's three, among `encoded`
  // Of the channels that the model has weights for, see Conv2dOptions.
  std::vector<std::optional<float>> constants;
};
HrlsChannels hrls_channels(const Architecture& architecture, const ConstantLayers& constants,
                           bool compute_variance = false);

}  // namespace raymeld
