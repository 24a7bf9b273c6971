#include "networks/model.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "io/safetensors.h"
#include "networks/network.h"

namespace raymeld {

Model::Model(const std::filesystem::path& file) : Model(read_safetensors(file), file.string()) {}

Model::Model(SafeTensors content, const std::string& file) : file_(file) {
  metadata_ = std::move(content.metadata);
  architecture_ = parse_architecture(metadata_, file_);
  const auto name = metadata_.find("name");
  name_ = name == metadata_.end() ? std::filesystem::path(file).stem().string() : name->second;
  for (auto& [key, data] : content.tensors) {
    if (!std::all_of(data.values.begin(), data.values.end(), [](float v) { return std::isfinite(v); })) {
      throw Error("model {}: tensor {} holds values that are not finite", file_, key);
    }
    tensors_[key] = {std::move(data.shape), std::move(data.values)};
  }
  check_tensors();
  if (architecture_.is_pyramid() && architecture_.knows_spp) weigh_samples();
}

// Makes the weights of conv_by_pixel(): the bias by samples takes the mean over the four pixels.
void Model::weigh_samples() {
  constexpr size_t kTaps = 9, kPixels = 4;
  const Values& weight = tensors_.at("hrls.weight");
  const size_t out = weight.shape[0], in = weight.shape[1];
  const std::vector<float>& by_spp = tensors_.at("hrls.by_spp").values;
  by_pixel_.assign(out * (in + kPixels) * kTaps, 0);
  for (size_t o = 0; o < out; ++o) {
    float* to = by_pixel_.data() + o * (in + kPixels) * kTaps;
    std::copy_n(weight.values.data() + o * in * kTaps, in * kTaps, to);
    for (size_t i = 0; i < kPixels; ++i) to[(in + i) * kTaps + kTaps / 2] = by_spp[o] / kPixels;
  }
}

ConvWeights Model::conv_by_pixel() const { return {by_pixel_, tensors_.at("hrls.bias").values}; }

// Builds the smallest network, which asks for every tensor by name and shape. No tensor may be unused.
void Model::check_tensors() const {
  Graph graph(Storage::kFloat32);
  network(graph, *this, 1, 1, 0);
  std::set<std::string> used;
  for (const ConstantRecord& constant : graph.constants()) used.insert(constant.name);
  if (architecture_.both_samplings) {
    tensor("lrhs.centered_bias", {architecture_.lrhs_features()});
    used.insert("lrhs.centered_bias");
  }
  if (architecture_.knows_spp) {  // network() asked for these
    used.insert("hrls.by_spp");
    if (architecture_.reads_lrhs()) used.insert("lrhs.by_spp");
  }
  for (const auto& [key, values] : tensors_) {
    if (!used.contains(key)) {
      throw Error("model {}: tensor {} belongs to no layer of the network that the metadata describes", file_,
                  key);
    }
  }
}

std::span<const float> Model::tensor(const std::string& name, const std::vector<size_t>& shape) const {
  const auto found = tensors_.find(name);
  if (found == tensors_.end()) {
    throw Error("model {}: tensor {} of shape [{}] is missing", file_, name, fmt::join(shape, ", "));
  }
  if (found->second.shape != shape) {
    throw Error("model {}: tensor {} has shape [{}], expected [{}]", file_, name,
                fmt::join(found->second.shape, ", "), fmt::join(shape, ", "));
  }
  return found->second.values;
}

ConvWeights Model::conv(const std::string& name, uint32_t out, uint32_t in, uint32_t kernel,
                        const std::string& bias) const {
  return {tensor(name + ".weight", {out, in, kernel, kernel}), tensor(name + "." + bias, {out})};
}

float Model::largest_weight() const {
  float largest = 0;
  for (const auto& [name, tensor] : tensors_) {
    if (!name.ends_with(".weight")) continue;
    for (const float value : tensor.values) largest = std::max(largest, std::abs(value));
  }
  return largest;
}

uint64_t Model::parameters() const {
  uint64_t count = 0;
  for (const auto& [key, values] : tensors_) count += values.values.size();
  return count;
}

}  // namespace raymeld
