// Tests OpenEXR files, written byte by byte, whose headers claim more than the file can hold.
#include "io/exr_claims.h"

#include <gtest/gtest.h>

#include "error_of.h"
#include "io/exr.h"
#include "support.h"

namespace raymeld::test {
namespace {

struct Window {
  int32_t min_x = 0, min_y = 0, max_x = 1, max_y = 0;
};

std::string named(const std::string& name, const std::string& type) { return name + '\0' + type + '\0'; }

std::string attribute(const std::string& name, const std::string& type, const std::string& value) {
  return named(name, type) + bytes_of(uint32_t(value.size())) + value;
}

// Returns the entry of a channel of halfs in a channel list.
std::string channel(const std::string& name) {
  return name + '\0' + bytes_of(std::array<int32_t, 4>{1, 0, 1, 1});
}

struct Parts {
  std::string channels = channel("Y") + '\0';
  Window window = {};
  std::string others = {};
  char compression = 0;
};

const std::string kMark = "\x76\x2f\x31\x01";
const std::string kPixels = {"\x00\x3c\x00\x3c", 4};  // two pixels, 1 and 1

std::string header_of(const Parts& parts) {
  std::string header = parts.others;
  header += attribute("channels", "chlist", parts.channels);
  header += attribute("compression", "compression", std::string(1, parts.compression));
  header += attribute("dataWindow", "box2i", bytes_of(parts.window));
  header += attribute("displayWindow", "box2i", bytes_of(Window{}));
  header += attribute("lineOrder", "lineOrder", std::string(1, '\0'));
  header += attribute("pixelAspectRatio", "float", bytes_of(1.0f));
  header += attribute("screenWindowCenter", "v2f", bytes_of(std::array<float, 2>{}));
  return header + attribute("screenWindowWidth", "float", bytes_of(1.0f)) + '\0';
}

std::string file_of(const Parts& parts) {
  const std::string file = kMark + bytes_of(uint32_t{2}) + header_of(parts);
  return file + bytes_of(uint64_t{file.size() + 8}) + bytes_of(std::array<int32_t, 2>{0, 4}) + kPixels;
}

// Returns a file of parts a and b, of which b claims `window`.
std::string file_of_two(const Window& window) {
  const auto part = [](const std::string& name, const Window& claimed) {
    return header_of({.window = claimed,
                      .others = attribute("name", "string", name) +
                                attribute("type", "string", "scanlineimage") +
                                attribute("chunkCount", "int", bytes_of(int32_t{1}))});
  };
  constexpr uint32_t kVersion = 2 | 1 << 12;  // version 2, with the flag of a file of several parts
  std::string file = kMark + bytes_of(kVersion) + part("a", {}) + part("b", window) + '\0';
  const uint64_t first = file.size() + 16;
  file += bytes_of(std::array<uint64_t, 2>{first, first + 16});
  for (const int32_t number : {0, 1}) file += bytes_of(std::array<int32_t, 3>{number, 0, 4}) + kPixels;
  return file;
}

class ExrClaims : public testing::Test {
 protected:
  std::string error_with(const Parts& parts) {
    return error_of([&] { read(parts); });
  }

  Image read(const Parts& parts) {
    write_file(folder_ / "a.exr", file_of(parts));
    return ExrFile(folder_ / "a.exr").read(std::array<std::string, 1>{"Y"});
  }

  TemporaryDirectory folder_;
};

TEST_F(ExrClaims, WhatIsTrueIsRead) {
  EXPECT_EQ(read({}).data, std::vector(2, 1.0f));
  const std::string text_list = bytes_of(uint32_t{3}) + "abc" + bytes_of(uint32_t{0});
  const std::string preview = bytes_of(std::array<uint32_t, 2>{2, 1}) + "RGBARGBA";
  EXPECT_EQ(read({.others = attribute("note", "string", "text") + attribute("empty", "string", "") +
                            attribute("list", "stringvector", text_list) +
                            attribute("floats", "floatvector", bytes_of(1.0f)) +
                            attribute("preview", "preview", preview) +
                            attribute("matrix", "m44f", std::string(64, '\0')) +
                            attribute("own", "of no known type", "12345")})
                .data,
            std::vector(2, 1.0f));
}

TEST_F(ExrClaims, AttributesBeyondTheFile) {
  for (const char* type : {"string", "stringvector", "floatvector", "preview", "chlist", "int", "unknown"}) {
    const std::string error =
        error_with({.others = named("note", type) + bytes_of(uint32_t{0x7fffffff}) + "text"});
    EXPECT_TRUE(
        contains(error, "its attribute 'note' claims 2147483647 bytes, which is more than the file has"))
        << error;
  }
}

// OpenEXR would take the rest of a value longer than its type, or the data after a shorter one, for a size.
TEST_F(ExrClaims, AttributesOfAnotherSizeThanTheirType) {
  const std::string text_list = bytes_of(uint32_t{0x7fffffff}) + "abc";
  for (const std::string& wrong :
       {attribute("note", "int", "12345"), attribute("note", "int", ""), attribute("note", "box2i", "1234"),
        attribute("note", "floatvector", "12345"), attribute("note", "stringvector", text_list),
        attribute("note", "chlist", channel("Y")),
        attribute("note", "chlist", channel("Y") + std::string(2, '\0')),
        attribute("note", "preview", bytes_of(std::array<uint32_t, 2>{0x7fffffff, 0x7fffffff})),
        attribute("note", "preview", bytes_of(std::array<uint32_t, 2>{2, 2}) + "RGBA")}) {
    const std::string error = error_with({.others = wrong});
    EXPECT_TRUE(contains(error, "its attribute 'note'") || contains(error, "ends within its header"))
        << error;
  }
}

TEST_F(ExrClaims, ImagesThatTheFileCannotHold) {
  constexpr int kMost = (1 << 30) - 1;
  const Window windows[] = {
      {.max_x = kMost, .max_y = kMost},
      {.max_x = 10'000'000},
      {.min_x = -kMost, .min_y = -kMost, .max_x = kMost, .max_y = kMost},
  };
  for (const Window& window : windows)
    for (const char compression : {0, 3, 4, 9})
      EXPECT_TRUE(contains(error_with({.window = window, .compression = compression}), "a.exr"));
  for (const char compression : {0, 3, 4, 9}) {
    const std::string error = error_with({.window = {.max_x = 100'000'000}, .compression = compression});
    EXPECT_TRUE(contains(error, "100000001 x 1 pixels of 1 channels cannot be in a file of")) << error;
  }
}

TEST_F(ExrClaims, PartsThatTheFileCannotHoldTogether) {
  write_file(folder_ / "a.exr", file_of_two({}));
  EXPECT_EQ(ExrFile(folder_ / "a.exr").channel_names(), (std::vector<std::string>{"a.Y", "b.Y"}));
  write_file(folder_ / "a.exr", file_of_two({.max_x = 10'000'000}));
  EXPECT_ERROR(ExrFile(folder_ / "a.exr"), "its parts up to part 1 cannot be in a file of");
}

TEST_F(ExrClaims, TilesThatAreLargerThanTheImage) {
  const std::string tiles = bytes_of(std::array<uint32_t, 2>{1 << 14, 1 << 14}) + '\0';
  const std::string tiled = attribute("tiles", "tiledesc", tiles) + attribute("type", "string", "tiledimage");
  EXPECT_TRUE(contains(error_with({.others = tiled}), "are larger than the image"));
}

}  // namespace
}  // namespace raymeld::test
