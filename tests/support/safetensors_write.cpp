#include <Imath/half.h>

#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>

#include "support.h"

namespace raymeld::test {
namespace {

std::string stored(const TensorData& tensor) {
  std::string bytes(tensor.values.size() * value_size_bytes(tensor.type), '\0');
  for (size_t i = 0; i < tensor.values.size(); ++i) {
    if (tensor.type == TensorType::kF32) {
      std::memcpy(bytes.data() + 4 * i, &tensor.values[i], 4);
    } else {
      const uint16_t bits = imath_float_to_half(tensor.values[i]);
      std::memcpy(bytes.data() + 2 * i, &bits, 2);
    }
  }
  return bytes;
}

}  // namespace

void write_safetensors(const std::filesystem::path& path, const SafeTensors& content) {
  nlohmann::json header = nlohmann::json::object();
  std::string data;
  if (!content.metadata.empty()) header["__metadata__"] = content.metadata;
  for (const auto& [name, tensor] : content.tensors) {
    const size_t begin = data.size();
    data += stored(tensor);
    header[name] = {{"dtype", tensor.type == TensorType::kF32 ? "F32" : "F16"},
                    {"shape", tensor.shape},
                    {"data_offsets", {begin, data.size()}}};
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');  // aligns the data
  const uint64_t length = text.size();
  write_file(path, std::string(reinterpret_cast<const char*>(&length), sizeof(length)) + text + data);
}

}  // namespace raymeld::test
