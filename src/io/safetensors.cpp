#include "io/safetensors.h"

#include <Imath/half.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "error.h"
#include "io/input_file.h"

namespace raymeld {
namespace {

static_assert(std::endian::native == std::endian::little,
              "the format is little endian, and its bytes are copied unchanged");

using Json = nlohmann::json;

constexpr size_t kLengthBytes = 8;
constexpr size_t kMaxHeaderBytes = 100'000'000;  // the format's own limit
constexpr int kMaxDepth = 3;                     // the file, a tensor, its shape

// Says where a tensor lies in the data section.
struct Extent {
  size_t begin;
  size_t end;
  std::string tensor;
  auto operator<=>(const Extent&) const = default;
};

class Parser {
 public:
  Parser(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  SafeTensors parse() {
    const Json header = parse_header();
    SafeTensors content;
    std::vector<Extent> extents;
    for (const auto& [key, value] : header.items()) {
      if (key == "__metadata__")
        content.metadata = parse_metadata(value);
      else
        content.tensors.emplace(key, parse_tensor(key, value, extents));
    }
    check_cover(extents);
    return content;
  }

 private:
  template <typename... Args>
  [[noreturn]] void fail(fmt::format_string<Args...> format, Args&&... args) const {
    throw Error("cannot read '{}' as safetensors: {}", name_,
                fmt::format(format, std::forward<Args>(args)...));
  }

  Json parse_header() {
    if (bytes_.size() < kLengthBytes) fail("{} bytes are too few for a header", bytes_.size());
    uint64_t length = 0;
    std::memcpy(&length, bytes_.data(), kLengthBytes);
    if (length > kMaxHeaderBytes)
      fail("a header of {} bytes is over the format's limit of {}", length, kMaxHeaderBytes);
    if (length > bytes_.size() - kLengthBytes)
      fail("the header should have {} bytes, but the file ends after {}", length,
           bytes_.size() - kLengthBytes);
    const std::string_view text = bytes_.substr(kLengthBytes, length);
    data_ = bytes_.substr(kLengthBytes + length);
    if (!text.starts_with('{')) fail("the header is not a JSON object");
    try {
      return Json::parse(text, [this](int depth, Json::parse_event_t event, Json& parsed) {
        check_event(depth, event, parsed);
        return true;
      });
    } catch (const Json::exception& error) {
      fail("the header is not valid JSON: {}", error.what());
    }
  }

  // The JSON library keeps the last of equal keys; here equal keys are an error.
  void check_event(int depth, Json::parse_event_t event, const Json& parsed) {
    using Event = Json::parse_event_t;
    if (event == Event::object_start || event == Event::array_start) {
      if (depth >= kMaxDepth) fail("the header is nested too deeply");
      keys_[depth + 1].clear();
    }
    if (event == Event::key && !keys_[depth].insert(parsed.get<std::string>()).second)
      fail("the header has the key '{}' twice", parsed.get<std::string>());
  }

  std::map<std::string, std::string> parse_metadata(const Json& json) const {
    if (!json.is_object()) fail("__metadata__ is not a JSON object");
    std::map<std::string, std::string> metadata;
    for (const auto& [key, value] : json.items()) {
      if (!value.is_string()) fail("the metadata '{}' is not a string", key);
      metadata[key] = value.get<std::string>();
    }
    return metadata;
  }

  TensorData parse_tensor(const std::string& tensor, const Json& json, std::vector<Extent>& extents) const {
    if (!json.is_object() || json.size() != 3 || !json.contains("dtype") || !json.contains("shape") ||
        !json.contains("data_offsets"))
      fail("tensor '{}' needs dtype, shape and data_offsets, and nothing else", tensor);
    TensorData data;
    data.type = parse_type(tensor, json["dtype"]);
    data.shape = parse_sizes(tensor, "shape", json["shape"]);
    const std::vector<size_t> offsets = parse_sizes(tensor, "data_offsets", json["data_offsets"]);
    if (offsets.size() != 2 || offsets[0] > offsets[1] || offsets[1] > data_.size())
      fail("tensor '{}' has data_offsets [{}], outside the {} bytes of data", tensor,
           fmt::join(offsets, ", "), data_.size());
    const size_t size_bytes = checked_size_bytes(tensor, data);
    if (offsets[1] - offsets[0] != size_bytes)
      fail("tensor '{}' of shape [{}] takes {} bytes, but its data_offsets span {}", tensor,
           fmt::join(data.shape, ", "), size_bytes, offsets[1] - offsets[0]);
    data.values = widen(data.type, data_.substr(offsets[0], size_bytes));
    extents.push_back({offsets[0], offsets[1], tensor});
    return data;
  }

  TensorType parse_type(const std::string& tensor, const Json& json) const {
    if (json == "F32") return TensorType::kF32;
    if (json == "F16") return TensorType::kF16;
    fail("tensor '{}' has the type {}; only F32 and F16 are supported", tensor, json.dump());
  }

  std::vector<size_t> parse_sizes(const std::string& tensor, std::string_view what, const Json& json) const {
    if (!json.is_array()) fail("{} of tensor '{}' is not an array", what, tensor);
    std::vector<size_t> sizes;
    for (const Json& value : json) {
      if (!value.is_number_unsigned()) fail("{} of tensor '{}' is not made of whole numbers", what, tensor);
      sizes.push_back(value.get<uint64_t>());
    }
    return sizes;
  }

  size_t checked_size_bytes(const std::string& tensor, const TensorData& data) const {
    size_t size_bytes = value_size_bytes(data.type);
    for (size_t extent : data.shape)
      if (__builtin_mul_overflow(size_bytes, extent, &size_bytes))
        fail("tensor '{}' of shape [{}] is too large", tensor, fmt::join(data.shape, ", "));
    return size_bytes;
  }

  static std::vector<float> widen(TensorType type, std::string_view bytes) {
    std::vector<float> values(bytes.size() / value_size_bytes(type));
    if (type == TensorType::kF32) {
      std::ranges::copy(bytes, reinterpret_cast<char*>(values.data()));
      return values;
    }
    for (size_t i = 0; i < values.size(); ++i) {
      uint16_t bits = 0;
      std::memcpy(&bits, bytes.data() + 2 * i, 2);
      values[i] = imath_half_to_float(bits);
    }
    return values;
  }

  void check_cover(std::vector<Extent>& extents) const {
    std::ranges::sort(extents);
    size_t end = 0;
    for (const Extent& extent : extents) {
      if (extent.begin < end) fail("tensor '{}' overlaps another", extent.tensor);
      if (extent.begin > end)
        fail("{} bytes before tensor '{}' belong to no tensor", extent.begin - end, extent.tensor);
      end = extent.end;
    }
    if (end != data_.size()) fail("{} bytes at the end belong to no tensor", data_.size() - end);
  }

  std::string_view bytes_;
  std::string_view data_;
  const std::string& name_;
  std::set<std::string> keys_[kMaxDepth + 1];  // keys of the open object at each depth
};

}  // namespace

SafeTensors parse_safetensors(std::string_view bytes, const std::string& name) {
  return Parser(bytes, name).parse();
}

SafeTensors read_safetensors(const std::filesystem::path& path) {
  check_input_file(path);
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) throw Error("cannot read '{}': the file exists, but cannot be opened", path.string());
  std::string bytes(size_t(file.tellg()), '\0');
  file.seekg(0);
  if (!file.read(bytes.data(), std::streamsize(bytes.size())))
    throw Error("cannot read '{}': reading stopped after {} of {} bytes", path.string(), file.gcount(),
                bytes.size());
  return parse_safetensors(bytes, path.string());
}

}  // namespace raymeld
