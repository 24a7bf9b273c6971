// Reads ONNX's published tests of single operators, as Debian's libonnx-testdata has them: model.onnx, which
// names the operator, and its inputs and outputs as tensors. They come from https://github.com/onnx/onnx,
// onnx/backend/test/data.
#pragma once

#include <onnx/onnx_pb.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "reference/bounds.h"

namespace raymeld::test {

struct OnnxArray {
  std::vector<int> dims;
  std::vector<float> values;
  bool is_float32 = false;  // `values` is empty if false
};

struct OnnxVector {
  std::string name;  // its folder in kOnnxData, such as "node/test_relu"
  std::string op;    // "PixelShuffle" also where the model composes it of several operators
  onnx::NodeProto node;
  std::vector<OnnxArray> inputs;  // the weights are among them
  OnnxArray output;
};

inline const std::filesystem::path kOnnxData = "/usr/share/libonnx-testdata/data";

template <typename Message>
Message read_onnx(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  Message message;
  if (!message.ParseFromIstream(&file)) throw std::runtime_error("cannot read " + path.string());
  return message;
}

inline OnnxArray to_array(const onnx::TensorProto& tensor) {
  OnnxArray array{{tensor.dims().begin(), tensor.dims().end()}, {}, false};
  array.is_float32 = tensor.data_type() == onnx::TensorProto::FLOAT;
  if (!array.is_float32) return array;
  array.values.assign(tensor.float_data().begin(), tensor.float_data().end());
  if (!tensor.has_raw_data()) return array;
  array.values.resize(tensor.raw_data().size() / sizeof(float));
  std::memcpy(array.values.data(), tensor.raw_data().data(), array.values.size() * sizeof(float));
  return array;
}

// Returns the operator that a model tests, or an empty string.
inline std::string tested_operator(const std::filesystem::path& folder, const onnx::GraphProto& graph) {
  if (folder.filename() == "test_PixelShuffle") return "PixelShuffle";
  return graph.node_size() == 1 ? graph.node(0).op_type() : "";
}

inline OnnxVector read_onnx_vector(const std::filesystem::path& folder, const std::string& op,
                                   const onnx::GraphProto& graph) {
  OnnxVector vector{std::filesystem::relative(folder, kOnnxData).string(), op, graph.node(0), {}, {}};
  const std::filesystem::path data = folder / "test_data_set_0";
  std::map<std::string, OnnxArray> by_name;
  for (const onnx::TensorProto& weights : graph.initializer()) by_name[weights.name()] = to_array(weights);
  int files = 0;
  for (const onnx::ValueInfoProto& input : graph.input()) {
    if (by_name.contains(input.name())) continue;
    const std::string file = "input_" + std::to_string(files++) + ".pb";
    by_name[input.name()] = to_array(read_onnx<onnx::TensorProto>(data / file));
  }
  if (op == "PixelShuffle") {
    vector.inputs = {by_name.at(graph.input(0).name())};
  } else {
    for (const std::string& input : vector.node.input()) vector.inputs.push_back(by_name.at(input));
  }
  vector.output = to_array(read_onnx<onnx::TensorProto>(data / "output_0.pb"));
  return vector;
}

// Returns all vectors that test one of the operators, by name, or none if the package is not installed.
inline std::map<std::string, OnnxVector> onnx_vectors(const std::set<std::string>& operators) {
  std::map<std::string, OnnxVector> vectors;
  if (!std::filesystem::exists(kOnnxData)) return vectors;
  for (const auto& file : std::filesystem::recursive_directory_iterator(kOnnxData)) {
    if (file.path().filename() != "model.onnx") continue;
    const auto model = read_onnx<onnx::ModelProto>(file.path());
    const std::filesystem::path folder = file.path().parent_path();
    const std::string op = tested_operator(folder, model.graph());
    if (!operators.contains(op)) continue;
    const OnnxVector vector = read_onnx_vector(folder, op, model.graph());
    vectors[vector.name] = vector;
  }
  return vectors;
}

inline int onnx_int(const onnx::NodeProto& node, const std::string& name, int absent) {
  for (const onnx::AttributeProto& a : node.attribute())
    if (a.name() == name) return int(a.i());
  return absent;
}
inline std::string onnx_text(const onnx::NodeProto& node, const std::string& name, std::string absent) {
  for (const onnx::AttributeProto& a : node.attribute())
    if (a.name() == name) return a.s();
  return absent;
}
inline std::vector<int> onnx_ints(const onnx::NodeProto& node, const std::string& name,
                                  std::vector<int> absent) {
  for (const onnx::AttributeProto& a : node.attribute())
    if (a.name() == name) return {a.ints().begin(), a.ints().end()};
  return absent;
}

// Returns the array as images: the dimensions before `axis` count images, `axis` counts channels, and those
// after it count pixels.
inline std::vector<reference::Planes> to_images(const OnnxArray& array, int axis) {
  const auto product = [](std::span<const int> dims) {
    int result = 1;
    for (int dim : dims) result *= dim;
    return result;
  };
  const std::span<const int> dims(array.dims), inner = dims.subspan(size_t(axis) + 1);
  const int c = dims[size_t(axis)], w = inner.empty() ? 1 : inner.back();
  const int h = inner.empty() ? 1 : product(inner.first(inner.size() - 1));
  std::vector<reference::Planes> images;
  for (int i = 0; i < product(dims.first(size_t(axis))); ++i) {
    const auto begin = array.values.begin() + std::ptrdiff_t(i) * c * h * w;
    images.emplace_back(c, h, w, std::vector<double>(begin, begin + std::ptrdiff_t(c) * h * w));
  }
  return images;
}

}  // namespace raymeld::test
