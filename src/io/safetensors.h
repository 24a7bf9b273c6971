#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace raymeld {

enum class TensorType { kF32, kF16 };

inline size_t value_size_bytes(TensorType type) { return type == TensorType::kF32 ? 4 : 2; }

struct TensorData {
  TensorType type = TensorType::kF32;  // the type in the file
  std::vector<size_t> shape;
  std::vector<float> values;  // row-major, widened to 32 bits
};

struct SafeTensors {
  std::map<std::string, std::string> metadata;
  std::map<std::string, TensorData> tensors;
};

// Checks every length, offset, type and name before use: the tensors must fill the data section without gap
// or overlap. Throws an Error that names `name` (the file) and the tensor. The format is described at
// https://huggingface.co/docs/safetensors.
SafeTensors parse_safetensors(std::string_view bytes, const std::string& name);

SafeTensors read_safetensors(const std::filesystem::path& path);

}  // namespace raymeld
