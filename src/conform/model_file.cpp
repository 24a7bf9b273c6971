#include "conform/model_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <sstream>

namespace raymeld::conform {
namespace {

using reference::Architecture;
using reference::LayerKind;
using reference::Transfer;
using reference::Upscale;

std::map<std::string, std::string> metadata_of(const Architecture& a) {
  // The reference knows layers only by kind, so one name for each kind and place is enough.
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
  std::map<std::string, std::string> shared{
      {"format", "raymeld.model"},
      {"format_version", "1"},
      {"name", "test"},
      {"version", "1"},
      {"scale", std::to_string(a.scale)},
      {"hrls_layers", fmt::format("{}", fmt::join(layers, ","))},
      {"transfer", a.transfer == reference::Transfer::kLog ? "log" : "linear"},
      {"clip", fmt::format("{}", a.clip)},
      {"upscaled_features", std::to_string(a.upscaled())},
      {"optional_layers", ""},
      {"exposure_key", "0"}};
  if (a.scale > 1) shared["lrhs_sampling"] = a.both_samplings ? "nearest,centered" : "nearest";
  if (a.upscaler != reference::Upscaler::kNone) {
    shared.insert({{"network", a.upscaler == reference::Upscaler::kEdsr ? "edsr" : "rcan"},
                   {"features", std::to_string(a.features)},
                   {"blocks", std::to_string(a.blocks)},
                   {"groups", std::to_string(a.groups)},
                   {"squeezed_features", std::to_string(a.squeezed_features)}});
    return shared;
  }
  if (a.is_kpcn()) {
    shared.insert({{"network", "kpcn"},
                   {"features", std::to_string(a.features)},
                   {"depth", std::to_string(a.depth)},
                   {"kernel_side", std::to_string(a.kernel_side)}});
    return shared;
  }
  if (a.is_pyramid()) {
    shared.insert({{"network", "pyramid"}, {"widths", fmt::format("{}", fmt::join(a.widths, ","))}});
    if (a.scale > 1) shared["lrhs_certainty"] = fmt::format("{}", a.lrhs_certainty);
    return shared;
  }
  shared.insert({{"features", std::to_string(a.features)},
                 {"growth", std::to_string(a.growth)},
                 {"dense_layers", std::to_string(a.dense_layers)},
                 {"blocks", std::to_string(a.blocks)},
                 {"groups", std::to_string(a.groups)},
                 {"long_skip", a.long_skip_fused ? "fused" : "lrhs"},
                 {"merge_relu", a.merge_relu ? "true" : "false"},
                 {"base", a.has_base ? "bilinear" : "none"},
                 {"hrls_encoder", a.hrls_unshuffled ? "unshuffled" : "full"},
                 {"hrls_kernel", std::to_string(a.hrls_kernel)},
                 {"upscale", a.upscale == Upscale::kDirect ? "direct" : "stages"},
                 {"guide", a.hrls_guide ? "hrls" : "none"},
                 {"head_features", std::to_string(a.head_features)},
                 {"head_layers", std::to_string(a.head_layers)}});
  return shared;
}

std::vector<LayerKind> layer_kinds(const std::string& list) {
  std::vector<LayerKind> kinds;
  std::istringstream stream(list);
  for (std::string name; std::getline(stream, name, ',');) {
    kinds.push_back(name == "albedo"     ? LayerKind::kAlbedo
                    : name == "normal"   ? LayerKind::kNormal
                    : name == "variance" ? LayerKind::kVariance
                                         : LayerKind::kRadiance);
  }
  return kinds;
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

Architecture read_architecture(const std::filesystem::path& model) {
  const std::map<std::string, std::string> metadata = read_safetensors(model).metadata;
  const auto number = [&](const char* key) { return std::stoi(metadata.at(key)); };
  const auto optional_number = [&](const char* key, int absent) {
    return metadata.contains(key) ? number(key) : absent;
  };
  const Transfer transfer = metadata.at("transfer") == "log" ? Transfer::kLog : Transfer::kLinear;
  const double clip = std::stof(metadata.at("clip"));
  const std::string network = metadata.contains("network") ? metadata.at("network") : "fusion";
  if (network == "edsr" || network == "rcan") {
    return {.upscaler = network == "edsr" ? reference::Upscaler::kEdsr : reference::Upscaler::kRcan,
            .scale = number("scale"),
            .features = number("features"),
            .blocks = number("blocks"),
            .groups = optional_number("groups", 0),
            .transfer = transfer,
            .clip = clip,
            .squeezed_features = optional_number("squeezed_features", 0)};
  }
  if (network == "kpcn") {
    return {.scale = 1,
            .features = number("features"),
            .hrls_layers = layer_kinds(metadata.at("hrls_layers")),
            .transfer = transfer,
            .clip = clip,
            .depth = number("depth"),
            .kernel_side = number("kernel_side")};
  }
  if (network == "pyramid") {
    std::vector<int> widths;
    std::istringstream stream(metadata.at("widths"));
    for (std::string width; std::getline(stream, width, ',');) widths.push_back(std::stoi(width));
    const bool reads_lrhs = number("scale") > 1;
    const auto text = [&](const char* key) { return reads_lrhs ? metadata.at(key) : "0"; };
    return {.scale = number("scale"),
            .hrls_layers = layer_kinds(metadata.at("hrls_layers")),
            .transfer = transfer,
            .clip = clip,
            .both_samplings = text("lrhs_sampling").find(',') != std::string::npos,
            .upscaled_features = number("upscaled_features"),
            .lrhs_certainty = std::stof(text("lrhs_certainty")),
            .knows_spp = metadata.contains("knows_spp") && metadata.at("knows_spp") == "true",
            .widths = widths};
  }
  return {.scale = number("scale"),
          .features = number("features"),
          .growth = number("growth"),
          .dense_layers = number("dense_layers"),
          .blocks = number("blocks"),
          .groups = number("groups"),
          .hrls_layers = layer_kinds(metadata.at("hrls_layers")),
          .long_skip_fused = metadata.at("long_skip") == "fused",
          .merge_relu = metadata.at("merge_relu") == "true",
          .has_base = metadata.at("base") == "bilinear",
          .transfer = transfer,
          .clip = clip,
          .hrls_unshuffled = metadata.at("hrls_encoder") == "unshuffled",
          .hrls_guide = metadata.at("guide") == "hrls",
          .both_samplings = metadata.at("lrhs_sampling").find(',') != std::string::npos,
          .upscale = metadata.at("upscale") == "direct" ? Upscale::kDirect : Upscale::kStages,
          .upscaled_features = number("upscaled_features"),
          .head_features = number("head_features"),
          .head_layers = number("head_layers"),
          .hrls_kernel = optional_number("hrls_kernel", 3),
          .knows_spp = metadata.contains("knows_spp") && metadata.at("knows_spp") == "true"};
}

reference::Weights read_weights(const std::filesystem::path& model) {
  const std::map<std::string, TensorData> tensors = read_safetensors(model).tensors;
  reference::Weights weights;
  for (const auto& [key, weight] : tensors) {
    if (!key.ends_with(".weight")) continue;
    const std::string name = key.substr(0, key.rfind('.'));
    const std::vector<float>& bias = tensors.at(name + ".bias").values;
    const auto centered = tensors.find(name + ".centered_bias");
    weights[name] = {.out = int(weight.shape.at(0)),
                     .in = int(weight.shape.at(1)),
                     .kernel = int(weight.shape.at(2)),
                     .weight = {weight.values.begin(), weight.values.end()},
                     .bias = {bias.begin(), bias.end()}};
    if (centered != tensors.end())
      weights[name].centered_bias = {centered->second.values.begin(), centered->second.values.end()};
    const auto by_spp = tensors.find(name + ".by_spp");
    if (by_spp != tensors.end())
      weights[name].by_spp = {by_spp->second.values.begin(), by_spp->second.values.end()};
  }
  return weights;
}

}  // namespace raymeld::conform
