#include "golden.h"

#include <fmt/format.h>

#include <sstream>
#include <stdexcept>

#include "io/safetensors.h"
#include "support.h"

namespace raymeld::test {
namespace {

using reference::Architecture;
using reference::Base;
using reference::Conv;
using reference::LayerKind;
using reference::Planes;
using reference::Transfer;

Planes take_planes(std::map<std::string, TensorData>& tensors, const std::string& name) {
  const auto node = tensors.extract(name);
  if (node.empty() || node.mapped().shape.size() != 3) throw std::runtime_error("golden: no planes " + name);
  const std::vector<size_t>& shape = node.mapped().shape;
  return planes(int(shape[0]), int(shape[1]), int(shape[2]), node.mapped().values);
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

Base base_of(const std::string& name) {
  return name == "joint" ? Base::kJoint : name == "bilinear" ? Base::kBilinear : Base::kNone;
}

// Layers without weights.
constexpr const char* kJointLayers[] = {"irradiance", "light",     "joint.0", "joint.1",
                                        "joint.2",    "joint.3",   "joint.4", "relight.1",
                                        "relight.3",  "relight.5", "mix"};

}  // namespace

const std::vector<std::string>& golden_names() {
  static const std::vector<std::string> names = {"tiny-x2",   "tiny-x4",   "tiny-x8",  "guided-x2",
                                                 "guided-x4", "guided-x8", "joint-x2", "joint-x4"};
  return names;
}

std::filesystem::path golden_model_path(const std::string& name) {
  return source_path(fmt::format("tests/golden/{}.safetensors", name));
}

Golden load_golden(const std::string& name) {
  const std::filesystem::path model = golden_model_path(name);
  Golden golden{load_architecture(model), load_weights(model), {}, {}, {}};
  SafeTensors content =
      read_safetensors(source_path(fmt::format("tests/golden/{}.golden.safetensors", name)));
  auto& tensors = content.tensors;
  if (content.metadata.at("lrhs_sampling") == "centered")
    golden.phase = (golden.architecture.scale - 1) / 2.0;
  golden.exposure = std::stod(content.metadata.at("exposure"));
  golden.lrhs = take_planes(tensors, "lrhs_input");
  golden.hrls = take_planes(tensors, "hrls_input");
  golden.outputs["output"] = take_planes(tensors, "output");
  for (const auto& [name, conv] : golden.weights) golden.outputs[name] = take_planes(tensors, name);
  if (golden.architecture.base == Base::kJoint) {
    for (const char* layer : kJointLayers) golden.outputs[layer] = take_planes(tensors, layer);
  }
  if (!tensors.empty()) throw std::runtime_error("golden: unknown layer " + tensors.begin()->first);
  return golden;
}

Architecture load_architecture(const std::filesystem::path& model) {
  const std::map<std::string, std::string> metadata = read_safetensors(model).metadata;
  const auto number = [&](const char* key) { return std::stoi(metadata.at(key)); };
  return {.scale = number("scale"),
          .features = number("features"),
          .growth = number("growth"),
          .dense_layers = number("dense_layers"),
          .blocks = number("blocks"),
          .groups = number("groups"),
          .hrls_layers = layer_kinds(metadata.at("hrls_layers")),
          .long_skip_fused = metadata.at("long_skip") == "fused",
          .merge_relu = metadata.at("merge_relu") == "true",
          .base = base_of(metadata.at("base")),
          .transfer = metadata.at("transfer") == "log" ? Transfer::kLog : Transfer::kLinear,
          .clip = std::stof(metadata.at("clip")),
          .hrls_unshuffled = metadata.at("hrls_encoder") == "unshuffled",
          .upscale_direct = metadata.at("upscale") == "direct",
          .hrls_guide = metadata.at("guide") == "hrls",
          .both_samplings = metadata.at("lrhs_sampling").find(',') != std::string::npos,
          .upscaled_features = number("upscaled_features"),
          .head_features = number("head_features"),
          .head_layers = number("head_layers"),
          .lrhs_certainty = std::stof(metadata.at("lrhs_certainty"))};
}

reference::Weights load_weights(const std::filesystem::path& model) {
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
    if (centered == tensors.end()) continue;
    weights[name].centered_bias = {centered->second.values.begin(), centered->second.values.end()};
  }
  return weights;
}

}  // namespace raymeld::test
