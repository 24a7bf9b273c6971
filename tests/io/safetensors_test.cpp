#include "io/safetensors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "error_of.h"
#include "support.h"

namespace raymeld {
namespace {

using test::TemporaryDirectory;

std::string little_endian(uint64_t value) {
  std::string bytes;
  for (int i = 0; i < 8; ++i) bytes += char(value >> 8 * i & 255);
  return bytes;
}

std::string file(const std::string& header, const std::string& data) {
  return little_endian(header.size()) + header + data;
}

SafeTensors parse(const std::string& header, const std::string& data = "") {
  return parse_safetensors(file(header, data), "m.safetensors");
}

// The data are 1.0f, -2.5f and, as halves, 0.5, 65504 and the smallest subnormal 2^-24.
const std::string kData("\x00\x00\x80\x3f\x00\x00\x20\xc0\x00\x38\xff\x7b\x01\x00", 14);
const std::string kHeader = R"({"__metadata__":{"format":"raymeld.model","scale":"4"},)"
                            R"("a.weight":{"dtype":"F32","shape":[2,1],"data_offsets":[0,8]},)"
                            R"("b":{"dtype":"F16","shape":[3],"data_offsets":[8,14]}})";

TEST(SafeTensors, ReadsKnownBytes) {
  const SafeTensors content = parse(kHeader, kData);
  EXPECT_EQ(content.metadata,
            (std::map<std::string, std::string>{{"format", "raymeld.model"}, {"scale", "4"}}));
  ASSERT_EQ(content.tensors.size(), 2u);
  const TensorData& a = content.tensors.at("a.weight");
  EXPECT_EQ(a.type, TensorType::kF32);
  EXPECT_EQ(a.shape, (std::vector<size_t>{2, 1}));
  EXPECT_EQ(a.values, (std::vector<float>{1.0f, -2.5f}));
  const TensorData& b = content.tensors.at("b");
  EXPECT_EQ(b.type, TensorType::kF16);
  EXPECT_EQ(b.shape, (std::vector<size_t>{3}));
  EXPECT_EQ(b.values, (std::vector<float>{0.5f, 65504.0f, 0x1p-24f}));
}

TEST(SafeTensors, ReadsScalarsEmptyTensorsAndAPaddedHeader) {
  const SafeTensors content = parse(
      R"({"s":{"dtype":"F32","shape":[],"data_offsets":[0,4]},"e":{"dtype":"F16","shape":[0,7],"data_offsets":[4,4]}}   )",
      kData.substr(0, 4));
  EXPECT_EQ(content.tensors.at("s").values, (std::vector<float>{1.0f}));
  EXPECT_TRUE(content.tensors.at("e").values.empty());
}

TEST(SafeTensors, RoundTripThroughAFile) {
  TemporaryDirectory directory;
  SafeTensors content;
  content.metadata = {{"name", "x4 \"quoted\" ü"}};
  content.tensors["w"] = {TensorType::kF32, {2, 2}, {1.5f, -0.0f, 1e-40f, 3e38f}};
  content.tensors["h"] = {TensorType::kF16, {2}, {0.25f, -65504.0f}};
  test::write_safetensors(directory / "a.safetensors", content);
  const SafeTensors read = read_safetensors(directory / "a.safetensors");
  EXPECT_EQ(read.metadata, content.metadata);
  ASSERT_EQ(read.tensors.size(), 2u);
  EXPECT_EQ(read.tensors.at("w").values, content.tensors["w"].values);
  EXPECT_TRUE(std::signbit(read.tensors.at("w").values[1]));
  EXPECT_EQ(read.tensors.at("h").values, content.tensors["h"].values);
  EXPECT_EQ(read.tensors.at("h").type, TensorType::kF16);
}

TEST(SafeTensors, RefusesAFileThatIsTooShort) {
  EXPECT_ERROR(parse_safetensors("", "m"), "'m'", "0 bytes");
  EXPECT_ERROR(parse_safetensors("1234567", "m"), "7 bytes");
  EXPECT_ERROR(parse_safetensors(little_endian(3) + "{}", "m"), "3 bytes", "ends after 2");
}

TEST(SafeTensors, RefusesAHugeHeaderLength) {
  EXPECT_ERROR(parse_safetensors(little_endian(UINT64_MAX) + "{}", "m"), "18446744073709551615");
  EXPECT_ERROR(parse_safetensors(little_endian(100'000'001) + "{}", "m"), "100000001", "limit");
}

TEST(SafeTensors, RefusesBadJson) {
  EXPECT_ERROR(parse(""), "not a JSON object");
  EXPECT_ERROR(parse("[]"), "not a JSON object");
  EXPECT_ERROR(parse(R"({"a":)"), "not valid JSON");
  EXPECT_ERROR(parse("{} {}"), "not valid JSON");
  EXPECT_ERROR(parse("{\"a\xff\":1}"), "not valid JSON");
  EXPECT_ERROR(parse(R"({"a":[[[[1]]]]})"), "nested too deeply");
  std::string deep = "{\"a\":";
  for (int i = 0; i < 100000; ++i) deep += '[';
  EXPECT_ERROR(parse(deep), "nested too deeply");
}

TEST(SafeTensors, RefusesDuplicateKeys) {
  EXPECT_ERROR(parse(R"({"a":{"dtype":"F32","shape":[0],"data_offsets":[0,0]},)"
                     R"("a":{"dtype":"F32","shape":[0],"data_offsets":[0,0]}})"),
               "'a' twice");
  EXPECT_ERROR(parse(R"({"__metadata__":{"k":"1","k":"2"}})"), "'k' twice");
  // Equal keys of different tensors are not duplicates.
  parse(
      R"({"a":{"dtype":"F32","shape":[0],"data_offsets":[0,0]},"b":{"dtype":"F32","shape":[0],"data_offsets":[0,0]}})");
}

TEST(SafeTensors, RefusesMetadataThatIsNoText) {
  EXPECT_ERROR(parse(R"({"__metadata__":{"scale":4}})"), "'scale' is not a string");
  EXPECT_ERROR(parse(R"({"__metadata__":[]})"), "__metadata__");
}

TEST(SafeTensors, RefusesOtherTypesByName) {
  for (const std::string type : {"BF16", "F64", "I8", "U8", "BOOL", "f32"})
    EXPECT_ERROR(parse(R"({"up.0.bias":{"dtype":")" + type + R"(","shape":[0],"data_offsets":[0,0]}})"),
                 "up.0.bias", type, "only F32 and F16");
  EXPECT_ERROR(parse(R"({"up.0.bias":{"dtype":7,"shape":[0],"data_offsets":[0,0]}})"), "up.0.bias", "7");
}

TEST(SafeTensors, RefusesMissingOrUnknownFields) {
  EXPECT_ERROR(parse(R"({"a":7})"), "'a' needs dtype");
  EXPECT_ERROR(parse(R"({"a":{"dtype":"F32","shape":[0]}})"), "'a' needs dtype");
  EXPECT_ERROR(parse(R"({"a":{"dtype":"F32","shape":[0],"offsets":[0,0]}})"), "'a' needs dtype");
  EXPECT_ERROR(parse(R"({"a":{"dtype":"F32","shape":[0],"data_offsets":[0,0],"x":1}})"), "nothing else");
}

TEST(SafeTensors, RefusesShapesAndOffsetsThatAreNotWholeNumbers) {
  const auto with = [](const std::string& shape, const std::string& offsets) {
    parse(R"({"a":{"dtype":"F32","shape":)" + shape + R"(,"data_offsets":)" + offsets + "}}",
          kData.substr(0, 8));
  };
  with("[2]", "[0,8]");
  EXPECT_ERROR(with("[-2]", "[0,8]"), "shape of tensor 'a'");
  EXPECT_ERROR(with("[2.0]", "[0,8]"), "shape of tensor 'a'");
  EXPECT_ERROR(with("[\"2\"]", "[0,8]"), "shape of tensor 'a'");
  EXPECT_ERROR(with("2", "[0,8]"), "shape of tensor 'a'");
  EXPECT_ERROR(with("[2]", "[0,1e1]"), "data_offsets of tensor 'a'");
  EXPECT_ERROR(with("[2]", "[0,99999999999999999999]"), "data_offsets of tensor 'a'");
  EXPECT_ERROR(with("[2]", "[0,4,8]"), "tensor 'a' has data_offsets [0, 4, 8]");
  EXPECT_ERROR(with("[2]", "[8,0]"), "[8, 0]");
  EXPECT_ERROR(with("[2]", "[0,12]"), "[0, 12]", "8 bytes of data");
  EXPECT_ERROR(with("[2]", "[4,8]"), "takes 8 bytes", "span 4");
  EXPECT_ERROR(with("[3]", "[0,8]"), "takes 12 bytes", "span 8");
}

TEST(SafeTensors, RefusesShapesThatOverflow) {
  // 2^62 * 4 bytes is 2^64, which would wrap to nothing.
  EXPECT_ERROR(parse(R"({"a":{"dtype":"F32","shape":[4611686018427387904],"data_offsets":[0,0]}})"), "'a'",
               "too large");
  EXPECT_ERROR(parse(R"({"a":{"dtype":"F16","shape":[4294967296,4294967296],"data_offsets":[0,0]}})"),
               "too large");
}

TEST(SafeTensors, RefusesOverlapsAndGaps) {
  const auto two = [](const std::string& a, const std::string& b, size_t size) {
    parse(R"({"a":{"dtype":"F32","shape":[1],"data_offsets":)" + a +
              R"(},"b":{"dtype":"F32","shape":[1],"data_offsets":)" + b + "}}",
          std::string(size, '\0'));
  };
  two("[4,8]", "[0,4]", 8);
  EXPECT_ERROR(two("[0,4]", "[0,4]", 4), "overlaps");
  EXPECT_ERROR(two("[0,4]", "[2,6]", 6), "'b' overlaps");
  EXPECT_ERROR(two("[0,4]", "[6,10]", 10), "2 bytes before tensor 'b'");
  EXPECT_ERROR(two("[0,4]", "[4,8]", 9), "1 bytes at the end");
}

TEST(SafeTensors, NamesTheFileThatItCannotRead) {
  TemporaryDirectory directory;
  EXPECT_ERROR(read_safetensors(directory / "none.safetensors"), "none.safetensors", "no such file");
  EXPECT_ERROR(read_safetensors(directory.path()), directory.path().string(), "a folder");
  test::write_file(directory / "empty", "");
  EXPECT_ERROR(read_safetensors(directory / "empty"), "empty", "too few");
}

// Every outcome but an Error or a well-formed result is a bug; the sanitizers see the rest.
bool survives(const std::string& bytes) {
  try {
    for (const auto& [name, tensor] : parse_safetensors(bytes, "m").tensors) {
      size_t count = 1;
      for (size_t extent : tensor.shape) count *= extent;
      EXPECT_EQ(count, tensor.values.size()) << name;
    }
    return true;
  } catch (const Error&) {
    return false;
  }
}

TEST(SafeTensors, SurvivesEveryTruncation) {
  const std::string whole = file(kHeader, kData);
  ASSERT_TRUE(survives(whole));
  for (size_t size = 0; size < whole.size(); ++size) EXPECT_FALSE(survives(whole.substr(0, size))) << size;
}

TEST(SafeTensors, SurvivesEveryChangeOfAByte) {
  const std::string whole = file(kHeader, kData);
  int refused = 0;
  for (size_t i = 0; i < whole.size(); ++i)
    for (int value : std::initializer_list<int>{0, 1, 9, '"', ',', '0', '9', ':', '[', '\\', ']', '{', '}',
                                                127, 128, 255}) {
      std::string changed = whole;
      changed[i] = char(value);
      refused += !survives(changed);
    }
  EXPECT_GT(refused, 1000);
}

TEST(SafeTensors, SurvivesRandomEdits) {
  const std::string whole = file(kHeader, kData);
  std::mt19937_64 random(7);
  for (int round = 0; round < 20000; ++round) {
    std::string changed = whole;
    for (int edit = 0; edit <= round % 4; ++edit) {
      const size_t at = random() % changed.size();
      const size_t count = random() % 9;
      switch (random() % 4) {
        case 0:
          changed.erase(at, count);
          break;
        case 1:
          changed.insert(at, whole.substr(random() % whole.size(), count));
          break;
        case 2:
          changed[at] = char(random());
          break;
        default:
          changed.replace(0, 8, little_endian(random() >> random() % 64));
      }
      if (changed.size() < 8) changed.resize(8);
    }
    survives(changed);
  }
}

}  // namespace
}  // namespace raymeld
