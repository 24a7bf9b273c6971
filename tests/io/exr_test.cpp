#include "io/exr.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDeepFrameBuffer.h>
#include <OpenEXR/ImfDeepScanLineOutputPart.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTiledOutputPart.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <sstream>
#include <thread>

#include "error_of.h"
#include "io/layers_from_exr.h"
#include "support.h"

namespace raymeld {
namespace {

using Imath::Box2i;
using Imath::V2i;
using test::TemporaryDirectory;
using Names = std::vector<std::string>;

// Returns the value at pixel (x, y) of channel c: a small whole number, so that half and uint hold it too.
float truth(int c, int x, int y) { return float(100 * c + 3 * (x + 20) + (y + 20)); }

struct TestPart {
  Imf::Header header;
  Names names;
  std::vector<Imf::PixelType> types;
};

// Writes channels whose values are truth(c, x, y), with x and y in the coordinates of the data window.
void write_part(Imf::MultiPartOutputFile& file, int index, const TestPart& part) {
  const Box2i window = part.header.dataWindow();
  const int width = window.max.x - window.min.x + 1, height = window.max.y - window.min.y + 1;
  Imf::FrameBuffer frame;
  std::vector<std::vector<uint32_t>> storage;
  storage.reserve(part.names.size());
  for (size_t c = 0; c < part.names.size(); ++c) {
    const Imf::Channel& channel = file.header(index).channels()[part.names[c]];
    const int w = width / channel.xSampling, h = height / channel.ySampling;
    char* bytes = reinterpret_cast<char*>(storage.emplace_back(size_t(w) * size_t(h)).data());
    const size_t size = channel.type == Imf::HALF ? 2 : 4;
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        const float value =
            truth(int(c), window.min.x + x * channel.xSampling, window.min.y + y * channel.ySampling);
        const half as_half = value;
        const uint32_t as_uint = uint32_t(value);
        const void* from = channel.type == Imf::HALF    ? static_cast<const void*>(&as_half)
                           : channel.type == Imf::FLOAT ? static_cast<const void*>(&value)
                                                        : static_cast<const void*>(&as_uint);
        std::memcpy(bytes + (size_t(y) * size_t(w) + size_t(x)) * size, from, size);
      }
    frame.insert(part.names[c], Imf::Slice::Make(channel.type, bytes, window, size, size * size_t(w),
                                                 channel.xSampling, channel.ySampling));
  }
  if (part.header.hasTileDescription()) {
    Imf::TiledOutputPart output(file, index);
    output.setFrameBuffer(frame);
    for (int level = 0; level < output.numLevels(); ++level)
      output.writeTiles(0, output.numXTiles(level) - 1, 0, output.numYTiles(level) - 1, level);
  } else {
    Imf::OutputPart output(file, index);
    output.setFrameBuffer(frame);
    output.writePixels(height);
  }
}

void write_parts(const std::filesystem::path& path, std::vector<TestPart> parts) {
  std::vector<Imf::Header> headers;
  for (TestPart& part : parts) {
    for (size_t c = 0; c < part.names.size(); ++c)
      if (!part.header.channels().findChannel(part.names[c]))
        part.header.channels().insert(part.names[c], Imf::Channel(part.types[c]));
    part.header.setType(part.header.hasTileDescription() ? Imf::TILEDIMAGE : Imf::SCANLINEIMAGE);
    headers.push_back(part.header);
  }
  Imf::MultiPartOutputFile file(path.c_str(), headers.data(), int(headers.size()));
  for (size_t i = 0; i < parts.size(); ++i) write_part(file, int(i), parts[i]);
}

Imf::Header header_of(int width, int height) { return Imf::Header(width, height); }

void expect_truth(const Image& image, int c, int truth_c, V2i origin, float tolerance = 0) {
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      ASSERT_NEAR(image.at(c, y, x), truth(truth_c, origin.x + x, origin.y + y), tolerance)
          << "channel " << c << " at " << x << ", " << y;
}

struct Storage {
  Imf::Compression compression;
  bool is_tiled;
};

class EveryStorage : public testing::TestWithParam<Storage> {};

TEST_P(EveryStorage, ReadsHalfFloatAndUint) {
  TemporaryDirectory directory;
  Imf::Header header = header_of(37, 41);
  header.compression() = GetParam().compression;
  if (GetParam().is_tiled) header.setTileDescription({16, 8, Imf::ONE_LEVEL});
  write_parts(directory / "a.exr",
              {{.header = header, .names = {"h.R", "f", "u"}, .types = {Imf::HALF, Imf::FLOAT, Imf::UINT}}});
  ExrFile file(directory / "a.exr");
  const Image image = file.read(Names{"u", "h.R", "f"});
  ASSERT_EQ(image.width, 37);
  ASSERT_EQ(image.height, 41);
  ASSERT_EQ(image.channels, 3);
  const bool is_lossy = GetParam().compression > Imf::PIZ_COMPRESSION;
  expect_truth(image, 0, 2, {0, 0});
  expect_truth(image, 1, 0, {0, 0}, is_lossy ? 2.0f : 0.0f);
  expect_truth(image, 2, 1, {0, 0}, is_lossy ? 0.01f : 0.0f);
}

std::vector<Storage> every_storage() {
  std::vector<Storage> all;
  for (int compression = 0; compression < Imf::NUM_COMPRESSION_METHODS; ++compression)
    for (bool is_tiled : {false, true}) all.push_back({Imf::Compression(compression), is_tiled});
  return all;
}

std::string storage_name(const testing::TestParamInfo<Storage>& info) {
  const std::array<std::string, Imf::NUM_COMPRESSION_METHODS> names = {
      "None", "Rle", "Zips", "Zip", "Piz", "Pxr24", "B44", "B44a", "Dwaa", "Dwab"};
  return names[size_t(info.param.compression)] + (info.param.is_tiled ? "Tiled" : "ScanLine");
}

INSTANTIATE_TEST_SUITE_P(Exr, EveryStorage, testing::ValuesIn(every_storage()), storage_name);

TEST(Exr, WindowsThatDiffer) {
  TemporaryDirectory directory;
  // The data window adds overscan on the left and above, and crops on the right and below.
  const Imf::Header header(Box2i({0, 0}, {15, 11}), Box2i({-7, -4}, {8, 5}));
  write_parts(directory / "a.exr",
              {{.header = header, .names = {"G", "R"}, .types = {Imf::FLOAT, Imf::HALF}}});
  ExrFile file(directory / "a.exr");
  EXPECT_EQ(file.header().displayWindow(), Box2i({0, 0}, {15, 11}));
  EXPECT_EQ(file.header().dataWindow(), Box2i({-7, -4}, {8, 5}));
  const Image image = file.read(Names{"R", "G"});
  EXPECT_EQ(image.width, 16);
  EXPECT_EQ(image.height, 10);
  expect_truth(image, 0, 1, {-7, -4});
  expect_truth(image, 1, 0, {-7, -4});
}

TEST(Exr, DecreasingLineOrderIsNotUpsideDown) {
  TemporaryDirectory directory;
  Imf::Header header = header_of(5, 40);
  header.lineOrder() = Imf::DECREASING_Y;
  write_parts(directory / "a.exr", {{.header = header, .names = {"Y"}, .types = {Imf::FLOAT}}});
  ExrFile file(directory / "a.exr");
  expect_truth(file.read(Names{"Y"}), 0, 0, {0, 0});
}

TEST(Exr, TheFullSizeLevelOfAMipMap) {
  TemporaryDirectory directory;
  Imf::Header header = header_of(33, 20);
  header.setTileDescription({8, 8, Imf::MIPMAP_LEVELS});
  write_parts(directory / "a.exr", {{.header = header, .names = {"Y"}, .types = {Imf::FLOAT}}});
  ExrFile file(directory / "a.exr");
  const Image image = file.read(Names{"Y"});
  EXPECT_EQ(image.width, 33);
  expect_truth(image, 0, 0, {0, 0});
}

TEST(Exr, SubSampledChannelsRepeatTheirSamples) {
  TemporaryDirectory directory;
  Imf::Header header(Box2i({0, 0}, {7, 7}), Box2i({-4, 2}, {3, 7}));
  header.channels().insert("RY", Imf::Channel(Imf::HALF, 2, 2));
  header.channels().insert("BY", Imf::Channel(Imf::FLOAT, 4, 1));
  write_parts(directory / "a.exr",
              {{.header = header, .names = {"Y", "RY", "BY"}, .types = {Imf::HALF, Imf::HALF, Imf::FLOAT}}});
  ExrFile file(directory / "a.exr");
  EXPECT_EQ(file.channel("RY").x_sampling, 2);
  EXPECT_EQ(file.channel("BY").y_sampling, 1);
  const Image image = file.read(Names{"BY", "Y", "RY"});
  expect_truth(image, 1, 0, {-4, 2});
  for (int y = 0; y < 6; ++y)
    for (int x = 0; x < 8; ++x) {
      EXPECT_EQ(image.at(2, y, x), truth(1, -4 + x / 2 * 2, 2 + y / 2 * 2)) << x << ", " << y;
      EXPECT_EQ(image.at(0, y, x), truth(2, -4 + x / 4 * 4, 2 + y)) << x << ", " << y;
    }
  const ExrRawChannel raw = file.read_raw("RY");
  ASSERT_EQ(raw.bytes.size(), 4u * 3u * 2u);
  half last;
  std::memcpy(&last, raw.bytes.data() + 22, 2);
  EXPECT_EQ(float(last), truth(1, 2, 6));
}

TEST(Exr, PartsNameTheirChannels) {
  TemporaryDirectory directory;
  std::vector<TestPart> parts = {
      {.header = header_of(6, 5), .names = {"A", "R"}, .types = {Imf::HALF, Imf::HALF}},
      {.header = header_of(6, 5), .names = {"albedo.R", "other.R"}, .types = {Imf::HALF, Imf::FLOAT}},
      {.header = header_of(6, 5), .names = {"Z"}, .types = {Imf::FLOAT}},
  };
  parts[0].header.setName("rgba");
  parts[1].header.setName("albedo");
  parts[2].header.setName("deep water");
  parts[2].header.setTileDescription({4, 4, Imf::ONE_LEVEL});
  write_parts(directory / "a.exr", parts);
  ExrFile file(directory / "a.exr");
  EXPECT_EQ(file.channel_names(), (Names{"rgba.A", "rgba.R", "albedo.R", "other.R", "deep water.Z"}));
  EXPECT_EQ(file.channel("deep water.Z").part, 2);
  EXPECT_EQ(file.header(2).name(), "deep water");
  const Image image = file.read(Names{"deep water.Z", "rgba.R", "other.R", "rgba.R"});
  expect_truth(image, 0, 0, {0, 0});
  expect_truth(image, 1, 1, {0, 0});
  expect_truth(image, 2, 1, {0, 0});
  expect_truth(image, 3, 1, {0, 0});
  EXPECT_EQ(file.read_raw("other.R").type, Imf::FLOAT);
}

// The parts may be the two eyes of a stereo file. A part that is named after its layer needs no second name.
TEST(Exr, PartsThatHoldTheSameChannels) {
  TemporaryDirectory directory;
  std::vector<TestPart> parts = {
      {.header = header_of(6, 5), .names = {"V.Combined.R", "V.Emit.R"}, .types = {Imf::HALF, Imf::HALF}},
      {.header = header_of(6, 5), .names = {"A.R", "V.Combined.R"}, .types = {Imf::HALF, Imf::HALF}},
      {.header = header_of(6, 5), .names = {"R", "Z"}, .types = {Imf::HALF, Imf::HALF}},
      {.header = header_of(6, 5), .names = {"Z"}, .types = {Imf::HALF}},
  };
  for (size_t i = 0; i < parts.size(); ++i)
    parts[i].header.setName(Names{"left", "V.Combined", "A", "far"}[i]);
  write_parts(directory / "a.exr", parts);
  ExrFile file(directory / "a.exr");
  EXPECT_EQ(file.channel_names(), (Names{"left.V.Combined.R", "V.Emit.R", "V.Combined.A.R", "V.Combined.R",
                                         "A.R", "A.Z", "far.Z"}));
  const Image image = file.read(Names{"V.Combined.R", "left.V.Combined.R", "A.R"});
  expect_truth(image, 0, 1, {0, 0});
  expect_truth(image, 1, 0, {0, 0});
  expect_truth(image, 2, 0, {0, 0});
}

TEST(Exr, PartsOfDifferentWindowsAreNotReadTogether) {
  TemporaryDirectory directory;
  std::vector<TestPart> parts = {
      {.header = header_of(6, 5), .names = {"R"}, .types = {Imf::HALF}},
      {.header = Imf::Header(Box2i({0, 0}, {5, 4}), Box2i({1, 1}, {3, 3})),
       .names = {"R"},
       .types = {Imf::HALF}},
  };
  parts[0].header.setName("a");
  parts[1].header.setName("b");
  write_parts(directory / "a.exr", parts);
  ExrFile file(directory / "a.exr");
  expect_truth(file.read(Names{"b.R"}), 0, 0, {1, 1});
  EXPECT_ERROR(file.read(Names{"a.R", "b.R"}), "a.exr", "'a.R'", "'b.R'", "data windows");
}

TEST(Exr, RawChannelsAreTheStoredBits) {
  TemporaryDirectory directory;
  write_parts(directory / "a.exr",
              {{.header = header_of(3, 2), .names = {"id", "h"}, .types = {Imf::UINT, Imf::HALF}}});
  ExrFile file(directory / "a.exr");
  const ExrRawChannel raw = file.read_raw("id");
  EXPECT_EQ(raw.type, Imf::UINT);
  EXPECT_EQ(raw.data_window, Box2i({0, 0}, {2, 1}));
  std::vector<uint32_t> ids(6);
  ASSERT_EQ(raw.bytes.size(), 24u);
  std::memcpy(ids.data(), raw.bytes.data(), 24);
  EXPECT_EQ(ids, (std::vector<uint32_t>{80, 83, 86, 81, 84, 87}));
  EXPECT_EQ(file.read_raw("h").bytes.size(), 12u);
}

TEST(Exr, UnknownChannelsAreNamed) {
  TemporaryDirectory directory;
  write_parts(directory / "a.exr", {{.header = header_of(3, 2), .names = {"R"}, .types = {Imf::HALF}}});
  ExrFile file(directory / "a.exr");
  EXPECT_ERROR(file.read(Names{"R", "Q"}), "a.exr", "'Q'");
  EXPECT_ERROR(file.read_raw("Q"), "a.exr", "'Q'");
  EXPECT_ERROR(file.read(Names{}), "a.exr");
}

TEST(Exr, DeepImagesAreRefused) {
  TemporaryDirectory directory;
  Imf::Header header(4, 3);
  header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
  header.setType(Imf::DEEPSCANLINE);
  header.setName("fog");
  header.compression() = Imf::ZIPS_COMPRESSION;
  {
    Imf::MultiPartOutputFile file((directory / "deep.exr").c_str(), &header, 1);
    Imf::DeepScanLineOutputPart output(file, 0);
    std::vector<unsigned> counts(12, 1);
    std::vector<float> depths(12, 2.5f);
    std::vector<float*> samples;
    for (float& depth : depths) samples.push_back(&depth);
    Imf::DeepFrameBuffer frame;
    frame.insertSampleCountSlice(Imf::Slice(Imf::UINT, reinterpret_cast<char*>(counts.data()), 4, 16));
    frame.insert("Z", Imf::DeepSlice(Imf::FLOAT, reinterpret_cast<char*>(samples.data()), 8, 32, 4));
    output.setFrameBuffer(frame);
    output.writePixels(3);
  }
  EXPECT_ERROR(ExrFile(directory / "deep.exr"), "deep.exr", "part 'fog'", "deep");
}

TEST(Exr, TruncatedFilesAreRefusedAtEveryLength) {
  TemporaryDirectory directory;
  for (bool is_tiled : {false, true}) {
    Imf::Header header = header_of(64, 48);
    header.compression() = Imf::ZIP_COMPRESSION;
    if (is_tiled) header.setTileDescription({16, 16, Imf::ONE_LEVEL});
    write_parts(directory / "whole.exr",
                {{.header = header, .names = {"B", "G", "R"}, .types = {Imf::HALF, Imf::HALF, Imf::FLOAT}}});
    const std::string whole = test::read_file(directory / "whole.exr");
    for (size_t size = 0; size < whole.size(); size += size < 600 ? 7 : 97) {
      test::write_file(directory / "cut.exr", whole.substr(0, size));
      EXPECT_ERROR(ExrFile(directory / "cut.exr").read(Names{"R", "G", "B"}), "cut.exr");
    }
    test::write_file(directory / "cut.exr", whole.substr(0, whole.size() - 1));
    EXPECT_ERROR(ExrFile(directory / "cut.exr").read(Names{"R", "G", "B"}), "cut.exr");
  }
}

// A renderer that was killed leaves chunk offsets of 0.
TEST(Exr, UnfinishedFilesAreRefused) {
  TemporaryDirectory directory;
  Imf::Header header = header_of(16, 16);
  header.compression() = Imf::NO_COMPRESSION;
  write_parts(directory / "a.exr", {{.header = header, .names = {"R"}, .types = {Imf::HALF}}});
  std::string bytes = test::read_file(directory / "a.exr");
  // The file ends with a table of 16 offsets of 8 bytes, and 16 lines of 8 bytes of head and 32 of pixels.
  const size_t table = bytes.size() - 16 * (8 + 32) - 16 * 8;
  ASSERT_NE(bytes[table + 15 * 8], 0);
  std::memset(bytes.data() + table + 15 * 8, 0, 8);
  test::write_file(directory / "cut.exr", bytes);
  EXPECT_ERROR(ExrFile(directory / "cut.exr"), "cut.exr", "truncated, or was never finished");
}

TEST(Exr, DamagedFilesAreRefusedOrRead) {
  TemporaryDirectory directory;
  Imf::Header header = header_of(24, 24);
  header.compression() = Imf::PIZ_COMPRESSION;
  write_parts(directory / "a.exr", {{.header = header, .names = {"R"}, .types = {Imf::HALF}}});
  const std::string whole = test::read_file(directory / "a.exr");
  int refused = 0;
  for (size_t at = whole.size() - 200; at < whole.size(); ++at) {
    std::string damaged = whole;
    damaged[at] = char(~damaged[at]);
    test::write_file(directory / "damaged.exr", damaged);
    try {
      ExrFile(directory / "damaged.exr").read(Names{"R"});
    } catch (const Error& error) {
      EXPECT_TRUE(test::contains(error.what(), "damaged.exr")) << error.what();
      ++refused;
    }
  }
  EXPECT_GT(refused, 0);
}

TEST(Exr, WhatIsNoFileOfImages) {
  TemporaryDirectory directory;
  EXPECT_ERROR(ExrFile(directory / "none.exr"), "none.exr", "there is no such file");
  EXPECT_ERROR(ExrFile{directory.path()}, directory.path().string(), "it is a folder");
  test::write_file(directory / "empty.exr", "");
  EXPECT_ERROR(ExrFile(directory / "empty.exr"), "empty.exr", "not an OpenEXR file");
  test::write_file(directory / "text.exr", "P3 1 1 255 0 0 0");
  EXPECT_ERROR(ExrFile(directory / "text.exr"), "text.exr", "not an OpenEXR file");
  ASSERT_EQ(mkfifo((directory / "pipe.exr").c_str(), 0600), 0);
  EXPECT_ERROR(ExrFile(directory / "pipe.exr"), "pipe.exr", "not a regular file");
}

TEST(Exr, FilesThatMayNotBeRead) {
  TemporaryDirectory directory;
  write_parts(directory / "a.exr", {{.header = header_of(3, 2), .names = {"R"}, .types = {Imf::HALF}}});
  ASSERT_EQ(chmod((directory / "a.exr").c_str(), 0), 0);
  ASSERT_EQ(chmod(directory.path().c_str(), 0755), 0);
  const bool is_root = geteuid() == 0;  // root may read everything
  ASSERT_EQ(is_root ? seteuid(65534) : 0, 0);
  EXPECT_ERROR(ExrFile(directory / "a.exr"), "a.exr", "Permission denied");
  ASSERT_EQ(is_root ? seteuid(0) : 0, 0);
}

// Reads the files of another writer, OpenImageIO.
class Oiiotool : public testing::Test {
 protected:
  void run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "oiiotool");
    const test::ProcessResult result = test::run_process(arguments);
    ASSERT_EQ(result.exit_status, 0) << result.err;
  }
  std::string path(const std::string& name) { return (directory_ / name).string(); }

  TemporaryDirectory directory_;
};

// OpenImageIO draws a ramp that is linear between the given corners.
const std::string kRamp = "fill:topleft=0,64,1:topright=16,64,1:bottomleft=8,0,1:bottomright=24,0,1";

void expect_ramp(const Image& image, float tolerance) {
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const float u = float(x) / float(image.width - 1), v = float(y) / float(image.height - 1);
      ASSERT_NEAR(image.at(0, y, x), 16 * u + 8 * v, tolerance) << x << ", " << y;
      ASSERT_NEAR(image.at(1, y, x), 64 - 64 * v, tolerance) << x << ", " << y;
      ASSERT_NEAR(image.at(2, y, x), 1, tolerance) << x << ", " << y;
    }
}

TEST_F(Oiiotool, EveryCompressionAndType) {
  for (const std::string compression :
       {"none", "rle", "zip", "zips", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab"})
    for (const std::string type : {"half", "float"}) {
      SCOPED_TRACE(compression + " " + type);
      run({"--pattern", kRamp, "33x17", "3", "-d", type, "--compression", compression, "-o", path("a.exr")});
      ExrFile file(directory_ / "a.exr");
      EXPECT_EQ(file.channel("R").type, type == "half" ? Imf::HALF : Imf::FLOAT);
      const bool is_lossy = compression.starts_with("b44") || compression.starts_with("dwa");
      expect_ramp(file.read(Names{"R", "G", "B"}), is_lossy ? 1.0f : type == "half" ? 0.02f : 0.001f);
    }
}

TEST_F(Oiiotool, TilesAndWindows) {
  run({"--pattern", kRamp, "33x17", "3", "--origin", "-5+3", "--fullsize", "20x10+0+0", "--tile", "16", "16",
       "-d", "float", "-o", path("a.exr")});
  ExrFile file(directory_ / "a.exr");
  EXPECT_EQ(file.header().dataWindow(), Box2i({-5, 3}, {27, 19}));
  EXPECT_EQ(file.header().displayWindow(), Box2i({0, 0}, {19, 9}));
  EXPECT_TRUE(file.header().hasTileDescription());
  expect_ramp(file.read(Names{"R", "G", "B"}), 1e-4f);
}

TEST_F(Oiiotool, MultiPartWithLayers) {
  run({"--pattern", kRamp, "33x17", "3", "--attrib", "oiio:subimagename", "beauty", "--pattern",
       "constant:color=0.25,0.5,0.75", "33x17", "3", "--attrib", "oiio:subimagename", "albedo", "--siappend",
       "-d", "float", "-o", path("a.exr")});
  ExrFile file(directory_ / "a.exr");
  const LayerMap map = map_layers(file);
  const Names wanted = {"albedo", "color"};
  const Image image = load_layers(file, map, wanted);
  EXPECT_EQ(image.at(0, 5, 5), 0.25f);
  EXPECT_EQ(image.at(1, 5, 5), 0.5f);
  EXPECT_EQ(image.at(2, 5, 5), 0.75f);
  EXPECT_NEAR(image.at(3, 16, 32), 24, 1e-4);
  EXPECT_NEAR(image.at(4, 0, 0), 64, 1e-4);
}

TEST_F(Oiiotool, PartsOfAnyNameWithBlendersChannels) {
  const auto names = [](const std::string& pass) {
    return "ViewLayer." + pass + ".R,ViewLayer." + pass + ".G,ViewLayer." + pass + ".B";
  };
  const auto part = [&](const std::string& name, const std::string& color, const std::string& channels) {
    const std::string count = std::to_string(1 + std::ranges::count(channels, ','));
    return Names{"--pattern", "constant:color=" + color, "8x4", count, "--chnames", channels,
                 "--attrib",  "oiio:subimagename",       name};
  };
  Names arguments = part("ViewLayer.Combined", "1,2,3", names("Combined"));
  for (const Names& more :
       {part("den", "4,5,6,7,8,9",
             names("Denoising Albedo") +
                 ",ViewLayer.Denoising Normal.X,ViewLayer.Denoising Normal.Y,ViewLayer.Denoising Normal.Z"),
        part("rest", "1,1,1,2,2,2,3,3,3",
             names("DiffCol") + "," + names("DiffDir") + "," + names("DiffInd"))})
    arguments.insert(arguments.end(), more.begin(), more.end());
  for (const std::string last : {"--siappendall", "-d", "float", "-o"}) arguments.push_back(last);
  arguments.push_back(path("a.exr"));
  run(arguments);
  ExrFile file(directory_ / "a.exr");
  ASSERT_EQ(file.channels().back().part, 2);
  const LayerMap map = map_layers(file);
  EXPECT_EQ(map.preset, "cycles");
  EXPECT_EQ(map.view_layer, "ViewLayer");
  const Image image = load_layers(file, map, Names{"color", "albedo", "normal", "diffuse"});
  for (int c = 0; c < 9; ++c) EXPECT_EQ(image.at(c, 3, 7), float(c + 1)) << c;
  for (int c = 9; c < 12; ++c) EXPECT_EQ(image.at(c, 3, 7), 5) << c;  // 1 * (2 + 3)
}

TEST_F(Oiiotool, ChannelNamesWithDotsAndSpaces) {
  run({"--pattern", "constant:color=1,2,3,0.5", "8x4", "4", "--chnames",
       "My Layer.001.Combined.R,My Layer.001.Combined.G,My Layer.001.Combined.B,My Layer.001.Combined.A",
       "-d", "half", "-o", path("a.exr")});
  ExrFile file(directory_ / "a.exr");
  const LayerMap map = map_layers(file);
  EXPECT_EQ(map.view_layer, "My Layer.001");
  EXPECT_EQ(map.alpha, "My Layer.001.Combined.A");
  const Names wanted = {"color"};
  EXPECT_EQ(load_layers(file, map, wanted).at(2, 3, 7), 3);
}

TEST_F(Oiiotool, DeepImagesAreRefused) {
  run({"--pattern", "constant:color=1,1,1,1,5", "8x4", "5", "--chnames", "R,G,B,A,Z", "--deepen", "-o",
       path("a.exr")});
  EXPECT_ERROR(ExrFile(directory_ / "a.exr"), "a.exr", "deep");
}

// Reads a file of Blender's with every Cycles pass of a small room.
class Blender : public testing::Test {
 protected:
  const std::filesystem::path path_ = test::source_path("tests/golden/blender-3.4.exr");
  ExrFile file_{path_};
};

std::string after(const std::string& text, const std::string& label) {
  const size_t begin = text.find(label);
  if (begin == std::string::npos) return {};
  return text.substr(begin + label.size(), text.find('\n', begin) - begin - label.size());
}

TEST_F(Blender, ChannelsAndMeansAreThoseThatOiiotoolSees) {
  const test::ProcessResult result =
      test::run_process({"oiiotool", "--info", "-v", "--stats", path_.string()});
  ASSERT_EQ(result.exit_status, 0) << result.err;
  std::istringstream names(after(result.out, "channel list: "));
  std::istringstream means(after(result.out, "Stats Avg: "));
  Names channels;
  for (std::string name; std::getline(names >> std::ws, name, ',');) channels.push_back(name);
  ASSERT_EQ(channels.size(), 48u);
  ASSERT_EQ(file_.channels().size(), 48u);
  const Image image = file_.read(channels);
  ASSERT_EQ(image.width, 16);
  ASSERT_EQ(image.height, 12);
  for (int c = 0; c < image.channels; ++c) {
    double mean = 0, sum = 0;
    ASSERT_TRUE(means >> mean);
    for (size_t i = 0; i < image.plane_size(); ++i) sum += image.plane(c)[i];
    EXPECT_NEAR(sum / double(image.plane_size()), mean, 2e-6) << channels[size_t(c)];
  }
}

TEST_F(Blender, TheMapIsCycles) {
  const LayerMap map = map_layers(file_);
  EXPECT_EQ(map.preset, "cycles");
  EXPECT_EQ(map.view_layer, "ViewLayer");
  EXPECT_EQ(map.layers.size(), 6u);
  EXPECT_EQ(map.alpha, "ViewLayer.Combined.A");
}

// The passes add up to the beauty (Hou et al. 2021, Eq. 1).
TEST_F(Blender, LayersAddUp) {
  const Names wanted = {"color", "diffuse", "specular"};
  const Image layers = load_layers(file_, map_layers(file_), wanted);
  for (int c = 0; c < 3; ++c) {
    const std::string channel = std::string(".") + "RGB"[c];
    const std::string pass = "ViewLayer.";
    const Image rest =
        file_.read(Names{pass + "TransCol" + channel, pass + "TransDir" + channel,
                         pass + "TransInd" + channel, pass + "Emit" + channel, pass + "Env" + channel});
    for (size_t i = 0; i < layers.plane_size(); ++i) {
      const float other =
          rest.plane(0)[i] * (rest.plane(1)[i] + rest.plane(2)[i]) + rest.plane(3)[i] + rest.plane(4)[i];
      EXPECT_NEAR(layers.plane(c)[i], layers.plane(3 + c)[i] + layers.plane(6 + c)[i] + other,
                  1e-4 * (1 + layers.plane(c)[i]));
    }
  }
}

void write_constant(const std::filesystem::path& path, float value) {
  const std::vector<float> pixels(64 * 64, value);
  ExrOutput output;
  output.source = Imf::Header(64, 64);
  output.compression = Imf::NO_COMPRESSION;
  output.planes = {{"R", Imf::FLOAT, pixels.data()}};
  write_exr(path, output);
}

// A renderer may write its next frame in place; a mixture of both frames is never returned as an image.
TEST(ExrFile, WrittenToWhileItIsRead) {
  TemporaryDirectory directory;
  const std::filesystem::path path = directory / "a.exr", other = directory / "other.exr";
  write_constant(other, 2);
  const std::string two = test::read_file(other);
  for (const std::string& content : {two, two.substr(0, two.size() / 2), two + "x", std::string(5000, 'x'),
                                     std::string(two.size(), '\xff'), std::string()}) {
    SCOPED_TRACE(content.size());
    write_constant(path, 1);
    ExrFile file(path);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // file times advance in ticks
    test::write_file(path, content);
    EXPECT_ERROR(file.read(Names{"R"}), "a.exr", "written to while it was being read");
    EXPECT_ERROR(file.read_raw("R"), "a.exr", "written to while it was being read");
  }
}

TEST(ExrFile, ReplacedOrRemovedWhileItIsRead) {
  TemporaryDirectory directory;
  const std::filesystem::path path = directory / "a.exr";
  for (const bool replaced : {true, false}) {
    write_constant(path, 1);
    ExrFile file(path);
    if (replaced) {
      write_constant(path, 2);  // takes the name once it is whole
    } else {
      std::filesystem::remove(path);
    }
    EXPECT_EQ(file.read(Names{"R"}).data, std::vector<float>(64 * 64, 1));
  }
}

}  // namespace
}  // namespace raymeld
