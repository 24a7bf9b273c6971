#include "golden.h"

#include <fmt/format.h>

#include <stdexcept>

#include "conform/model_file.h"
#include "io/safetensors.h"
#include "support.h"

namespace raymeld::test {
namespace {

using reference::Planes;

Planes take_planes(std::map<std::string, TensorData>& tensors, const std::string& name) {
  const auto node = tensors.extract(name);
  if (node.empty() || node.mapped().shape.size() != 3) throw std::runtime_error("golden: no planes " + name);
  const std::vector<size_t>& shape = node.mapped().shape;
  return planes(int(shape[0]), int(shape[1]), int(shape[2]), node.mapped().values);
}

// These layers have outputs but no weights.
std::vector<std::string> layers_without_weights(const reference::Architecture& a) {
  if (a.is_kpcn()) return {"light", "remainder", "gradients", "filter.diffuse", "filter.rest", "remodulate"};
  std::vector<std::string> layers;
  if (a.is_pyramid()) {
    layers = {"light", "filter.0", "filter.1", "filter.2", "filter.3", "compose"};
    if (a.scale > 1) layers.push_back("cell_light");
  }
  if (a.upscaler == reference::Upscaler::kRcan) {
    for (int block = 0; block < a.groups * a.blocks; ++block) {
      const std::string name = fmt::format("groups.{}.blocks.{}", block / a.blocks, block % a.blocks);
      for (const char* part : {".means", ".attend"}) layers.push_back(name + part);
    }
  }
  return layers;
}

}  // namespace

const std::vector<std::string>& golden_names() {
  static const std::vector<std::string> names = {
      "tiny-x2", "tiny-x4", "tiny-x8", "guided-x2",  "guided-x4",  "guided-x8", "spp-x4",
      "edsr-x4", "rcan-x2", "kpcn-x1", "pyramid-x1", "pyramid-x2", "pyramid-x4"};
  return names;
}

std::filesystem::path golden_model_path(const std::string& name) {
  return source_path(fmt::format("tests/golden/{}.safetensors", name));
}

Golden load_golden(const std::string& name) {
  const std::filesystem::path model = golden_model_path(name);
  Golden golden{conform::read_architecture(model), conform::read_weights(model), {}, {}, {}};
  SafeTensors content =
      read_safetensors(source_path(fmt::format("tests/golden/{}.golden.safetensors", name)));
  auto& tensors = content.tensors;
  if (content.metadata.at("lrhs_sampling") == "centered")
    golden.phase = (golden.architecture.scale - 1) / 2.0;
  golden.exposure = std::stod(content.metadata.at("exposure"));
  if (golden.architecture.knows_spp) {
    golden.samples = {std::stof(content.metadata.at("lrhs_spp")), std::stof(content.metadata.at("hrls_spp"))};
    take_samples(golden.architecture, golden.weights, golden.samples.lrhs, golden.samples.hrls);
  }
  golden.lrhs = take_planes(tensors, "lrhs_input");
  golden.hrls =
      golden.architecture.upscaler != reference::Upscaler::kNone
          ? Planes(0, golden.architecture.scale * golden.lrhs.h, golden.architecture.scale * golden.lrhs.w)
          : take_planes(tensors, "hrls_input");
  golden.outputs["output"] = take_planes(tensors, "output");
  for (const auto& [name, conv] : golden.weights) golden.outputs[name] = take_planes(tensors, name);
  for (const std::string& layer : layers_without_weights(golden.architecture))
    golden.outputs[layer] = take_planes(tensors, layer);
  if (golden.architecture.is_pyramid()) {
    for (const char level : {'1', '2', '3'}) {
      golden.outputs[fmt::format("pool.{}", level)] =
          concat(take_planes(tensors, fmt::format("pool.{}", level)),
                 take_planes(tensors, fmt::format("guides.{}", level)));
    }
  }
  if (!tensors.empty()) throw std::runtime_error("golden: unknown layer " + tensors.begin()->first);
  return golden;
}

}  // namespace raymeld::test
