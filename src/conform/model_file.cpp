#include "conform/model_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace raymeld::conform {
namespace {

using reference::Architecture;
using reference::LayerKind;

std::map<std::string, std::string> metadata_of(const Architecture& a) {
  using reference::Base;
  // Layers are known by kind here; one name for each kind and place will do.
  std::vector<std::string> radiance{"color", "diffuse", "specular"}, layers;
  for (const LayerKind kind : a.hrls_layers) {
    if (kind == LayerKind::kRadiance) {
      layers.push_back(radiance.front());
      radiance.erase(radiance.begin());
    } else {
      layers.push_back(kind == LayerKind::kAlbedo   ? "albedo"
                       : kind == LayerKind::kNormal ? "normal"
                                                    : "variance");
    }
  }
  return {{"format", "raymeld.model"},
          {"format_version", "1"},
          {"name", "test"},
          {"version", "1"},
          {"scale", std::to_string(a.scale)},
          {"features", std::to_string(a.features)},
          {"growth", std::to_string(a.growth)},
          {"dense_layers", std::to_string(a.dense_layers)},
          {"blocks", std::to_string(a.blocks)},
          {"groups", std::to_string(a.groups)},
          {"hrls_layers", fmt::format("{}", fmt::join(layers, ","))},
          {"long_skip", a.long_skip_fused ? "fused" : "lrhs"},
          {"merge_relu", a.merge_relu ? "true" : "false"},
          {"transfer", a.transfer == reference::Transfer::kLog ? "log" : "linear"},
          {"clip", fmt::format("{}", a.clip)},
          {"base", a.base == Base::kJoint      ? "joint"
                   : a.base == Base::kBilinear ? "bilinear"
                                               : "none"},
          {"hrls_encoder", a.hrls_unshuffled ? "unshuffled" : "full"},
          {"upscale", a.upscale_direct ? "direct" : "stages"},
          {"upscaled_features", std::to_string(a.upscaled())},
          {"guide", a.hrls_guide ? "hrls" : "none"},
          {"head_features", std::to_string(a.head_features)},
          {"head_layers", std::to_string(a.head_layers)},
          {"lrhs_sampling", a.both_samplings ? "nearest,centered" : "nearest"},
          {"optional_layers", ""},
          {"exposure_key", "0"},
          {"lrhs_certainty", fmt::format("{}", a.lrhs_certainty)}};
}

}  // namespace

SafeTensors model_file(const Architecture& architecture, const reference::Weights& weights,
                       const std::map<std::string, std::string>& other) {
  SafeTensors content;
  content.metadata = other;
  content.metadata.merge(metadata_of(architecture));
  for (const auto& [name, conv] : weights) {
    const auto [out, in, kernel] = std::tuple(size_t(conv.out), size_t(conv.in), size_t(conv.kernel));
    content.tensors[name + ".weight"] = {
        TensorType::kF32, {out, in, kernel, kernel}, {conv.weight.begin(), conv.weight.end()}};
    content.tensors[name + ".bias"] = {TensorType::kF32, {out}, {conv.bias.begin(), conv.bias.end()}};
    if (conv.centered_bias.empty()) continue;
    content.tensors[name + ".centered_bias"] = {
        TensorType::kF32, {out}, {conv.centered_bias.begin(), conv.centered_bias.end()}};
  }
  return content;
}

}  // namespace raymeld::conform
