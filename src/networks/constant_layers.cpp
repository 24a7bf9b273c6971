#include "networks/constant_layers.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

namespace raymeld {
namespace {

bool follows_exposure(ChannelKind kind) {
  return kind == ChannelKind::kRadiance || kind == ChannelKind::kVariance;
}

// Clamps a value as encode() does, but without the exposure and the clip.
float clamped(float value, ChannelKind kind) {
  const float low = kind == ChannelKind::kNormal ? -1 : 0;
  const float high = follows_exposure(kind) ? std::numeric_limits<float>::max() : 1;
  return std::isnan(value) ? 0 : std::clamp(value, low, high);
}

bool may_be_constant(float value, ChannelKind kind) {
  return clamped(value, kind) == value && !(follows_exposure(kind) && value > 0);
}

// Returns the one value that all of a channel is encoded as at any exposure, if there is one.
std::optional<float> constant_of(std::span<const float> values, ChannelKind kind) {
  const float first = clamped(values.front(), kind);
  const bool same = may_be_constant(first, kind) &&
                    std::ranges::all_of(values, [&](float value) { return clamped(value, kind) == first; });
  return same ? std::optional(first) : std::nullopt;
}

}  // namespace

void check_constant_layers(const Model& model, const ConstantLayers& constants) {
  const Architecture& a = model.architecture();
  for (const auto& [layer, values] : constants) {
    if (layer == "color" || std::ranges::find(a.hrls_layers, layer) == a.hrls_layers.end()) {
      throw Error("model {} has no layer '{}' that can be constant; expected one of {} other than color",
                  model.name(), layer, fmt::join(a.hrls_layers, ", "));
    }
    for (const float value : values) {
      if (!may_be_constant(value, kind_of(layer)))
        throw Error(
            "layer {} cannot have the constant value {}: it is out of range or depends on the exposure",
            layer, value);
    }
  }
}

std::vector<std::string> image_layers(const Architecture& a, const ConstantLayers& constants,
                                      bool compute_variance) {
  std::vector<std::string> layers = a.hrls_layers;
  std::erase_if(layers, [&](const std::string& layer) {
    return constants.contains(layer) || (compute_variance && layer == "variance");
  });
  return layers;
}

void take_constant_layers(const Architecture& a, Image& hrls, ConstantLayers& constants) {
  const size_t plane = hrls.plane_size();
  int written = 0, next = 0;  // channels
  for (const std::string& layer : image_layers(a, constants)) {
    std::array<float, 3> values{};
    bool constant = layer != "color";
    for (int c = 0; c < 3 && constant; ++c) {
      const auto value = constant_of({hrls.plane(next + c), plane}, kind_of(layer));
      constant = value.has_value();
      values[size_t(c)] = value.value_or(0);
    }
    if (constant) {
      constants[layer] = values;
    } else {
      if (written != next) std::copy_n(hrls.plane(next), 3 * plane, hrls.plane(written));
      written += 3;
    }
    next += 3;
  }
  hrls.channels = written;
  hrls.data.resize(size_t(written) * plane);
}

HrlsChannels hrls_channels(const Architecture& a, const ConstantLayers& constants, bool compute_variance) {
  HrlsChannels result;
  const auto append = [&](const std::string& layer, const auto& channel_of) {
    result.first[layer] = static_cast<uint32_t>(result.encoded.size());
    for (uint32_t c = 0; c < 3; ++c) result.encoded.push_back(channel_of(c));
  };
  uint32_t next = 0;
  for (const std::string& layer : a.hrls_layers) {
    const auto constant = constants.find(layer);
    if (constant != constants.end()) {
      append(layer, [&](uint32_t c) { return EncodedChannel{kind_of(layer), 0, constant->second[c]}; });
      continue;
    }
    const bool computed = compute_variance && layer == "variance";
    if (computed) result.variance = static_cast<uint32_t>(result.encoded.size());
    append(layer, [&](uint32_t c) { return EncodedChannel{kind_of(layer), computed ? c : next++}; });
  }
  return result;
}

}  // namespace raymeld
