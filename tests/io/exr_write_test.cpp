#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfChromaticitiesAttribute.h>
#include <OpenEXR/ImfFloatAttribute.h>
#include <OpenEXR/ImfOpaqueAttribute.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfPreviewImageAttribute.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstring>
#include <limits>

#include "error_of.h"
#include "io/exr.h"
#include "support.h"

namespace raymeld {
namespace {

using Imath::Box2i;
using test::TemporaryDirectory;
using Names = std::vector<std::string>;
namespace fs = std::filesystem;

constexpr float kInf = std::numeric_limits<float>::infinity();

// Makes writes fail that would grow a file beyond `size_bytes`, as on a full disk, for as long as it exists.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(size_t size_bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = size_bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_;
  void (*handler_)(int);
};

Names files_in(const fs::path& directory) {
  Names names;
  for (const auto& entry : fs::directory_iterator(directory)) names.push_back(entry.path().filename());
  return names;
}

std::vector<float> noise(size_t count) {
  std::vector<float> values(count);
  for (size_t i = 0; i < count; ++i) values[i] = float((i * 2654435761u >> 7) % 4096) / 64;
  return values;
}

template <typename T>
ExrRawChannel raw_channel(const std::string& name, Imf::PixelType type, const Box2i& window,
                          const std::vector<T>& values, int sampling = 1) {
  ExrRawChannel raw{.name = name,
                    .type = type,
                    .x_sampling = sampling,
                    .y_sampling = sampling,
                    .data_window = window,
                    .bytes = {}};
  raw.bytes.resize(values.size() * sizeof(T));
  std::memcpy(raw.bytes.data(), values.data(), raw.bytes.size());
  return raw;
}

ExrOutput rgb_output(const std::vector<float>& pixels, int width, int height,
                     Imf::PixelType type = Imf::FLOAT) {
  ExrOutput output;
  output.source = Imf::Header(width, height);
  for (const std::string name : {"R", "G", "B"}) output.planes.push_back({name, type, pixels.data()});
  return output;
}

TEST(WriteExr, EveryCompressionRoundTrips) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = noise(45 * 33);
  for (int compression = 0; compression < Imf::NUM_COMPRESSION_METHODS; ++compression) {
    SCOPED_TRACE(compression);
    ExrOutput output = rgb_output(pixels, 45, 33);
    output.compression = Imf::Compression(compression);
    output.planes[1].type = Imf::HALF;
    EXPECT_EQ(write_exr(directory / "a.exr", output), 0u);
    ExrFile file(directory / "a.exr");
    EXPECT_EQ(file.header().compression(), compression);
    EXPECT_EQ(file.channel("R").type, Imf::FLOAT);
    EXPECT_EQ(file.channel("G").type, Imf::HALF);
    const Image image = file.read(Names{"R", "G"});
    // The values are multiples of 1/64 below 64: twelve bits, one too many for half at the top.
    const bool is_lossless = compression <= Imf::PIZ_COMPRESSION;
    for (size_t i = 0; i < pixels.size(); ++i) {
      ASSERT_NEAR(image.plane(0)[i], pixels[i],
                  is_lossless                             ? 0
                  : compression == Imf::PXR24_COMPRESSION ? 0.002
                                                          : 12)
          << i;
      ASSERT_NEAR(image.plane(1)[i], pixels[i],
                  is_lossless || compression == Imf::PXR24_COMPRESSION ? 1.0 / 64 : 12)
          << i;
    }
  }
  EXPECT_EQ(files_in(directory.path()), Names{"a.exr"});
}

TEST(WriteExr, HalfClampsAndCounts) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = {65504, 65505, 1e9f, -1e9f, kInf, -65504, 1, -0.5f};
  const ExrOutput output = rgb_output(pixels, 4, 2, Imf::HALF);
  EXPECT_EQ(write_exr(directory / "a.exr", output), 3u * 4u);
  ExrFile file(directory / "a.exr");
  EXPECT_EQ(file.read(Names{"G"}).data,
            (std::vector<float>{65504, 65504, 65504, -65504, 65504, -65504, 1, -0.5f}));
}

TEST(WriteExr, FloatIsNotClamped) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = {1e30f, kInf, -kInf, 1e-40f};
  EXPECT_EQ(write_exr(directory / "a.exr", rgb_output(pixels, 2, 2)), 0u);
  ExrFile file(directory / "a.exr");
  EXPECT_EQ(file.read(Names{"B"}).data, pixels);
}

TEST(WriteExr, TakesWindowsAndAttributesOver) {
  TemporaryDirectory directory;
  Imf::Header source(Box2i({0, 0}, {99, 49}), Box2i({-3, -2}, {4, 5}), 2.0f, {0.5f, -0.25f}, 1.5f);
  Imf::Chromaticities p3;
  p3.red = {0.68f, 0.32f};
  Imf::addChromaticities(source, p3);
  source.insert("cycles.ViewLayer.samples", Imf::StringAttribute("16"));
  source.insert("studio.shot", Imf::FloatAttribute(42.5f));
  source.insert("envmap.of.nobody", Imf::OpaqueAttribute("unheardOf"));
  source.setTileDescription({32, 32, Imf::ONE_LEVEL});
  source.setName("a part");
  source.setType(Imf::TILEDIMAGE);
  source.channels().insert("left behind", Imf::Channel(Imf::HALF));
  source.setPreviewImage(Imf::PreviewImage(2, 2));
  source.lineOrder() = Imf::RANDOM_Y;
  source.compression() = Imf::B44_COMPRESSION;
  const std::vector<float> pixels = noise(64);
  ExrOutput output;
  output.source = source;
  output.planes = {{"R", Imf::HALF, pixels.data()}};
  write_exr(directory / "a.exr", output);
  ExrFile file(directory / "a.exr");
  const Imf::Header& header = file.header();
  EXPECT_EQ(header.displayWindow(), Box2i({0, 0}, {99, 49}));
  EXPECT_EQ(header.dataWindow(), Box2i({-3, -2}, {4, 5}));
  EXPECT_EQ(header.pixelAspectRatio(), 2.0f);
  EXPECT_EQ(header.screenWindowCenter(), Imath::V2f(0.5f, -0.25f));
  EXPECT_EQ(header.screenWindowWidth(), 1.5f);
  EXPECT_EQ(Imf::chromaticities(header).red, Imath::V2f(0.68f, 0.32f));
  EXPECT_EQ(header.typedAttribute<Imf::StringAttribute>("cycles.ViewLayer.samples").value(), "16");
  EXPECT_EQ(header.typedAttribute<Imf::FloatAttribute>("studio.shot").value(), 42.5f);
  EXPECT_STREQ(header["envmap.of.nobody"].typeName(), "unheardOf");
  EXPECT_EQ(header.compression(), Imf::ZIP_COMPRESSION);
  EXPECT_EQ(header.lineOrder(), Imf::INCREASING_Y);
  EXPECT_FALSE(header.hasTileDescription());
  EXPECT_FALSE(header.hasPreviewImage());
  EXPECT_EQ(file.channel_names(), Names{"R"});
  EXPECT_EQ(file.read(Names{"R"}).width, 8);
}

TEST(WriteExr, AttributesOfLayersLeftBehindAreDropped) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = noise(4);
  ExrOutput output = rgb_output(pixels, 2, 2);
  output.source.insert("BlenderMultiChannel", Imf::StringAttribute("Blender"));
  output.source.insert("cryptomatte/1a2b3c/name", Imf::StringAttribute("V.CryptoObject"));
  output.source.insert("cryptomatte/1a2b3c/manifest", Imf::StringAttribute("{}"));
  output.source.insert("cryptomatte/4d5e6f/name", Imf::StringAttribute("V.CryptoAsset"));
  const Box2i window = output.source.dataWindow();
  output.pass_through = {raw_channel("A", Imf::HALF, window, std::vector<half>(4, 1.0f))};
  write_exr(directory / "rgba.exr", output);
  EXPECT_FALSE(ExrFile(directory / "rgba.exr")
                   .header()
                   .findTypedAttribute<Imf::StringAttribute>("BlenderMultiChannel"));
  output.pass_through.push_back(raw_channel("V.CryptoObject00.r", Imf::FLOAT, window, pixels));
  write_exr(directory / "layers.exr", output);
  const ExrFile file(directory / "layers.exr");
  const auto value = [&](const char* attribute) {
    return file.header().findTypedAttribute<Imf::StringAttribute>(attribute);
  };
  EXPECT_TRUE(value("BlenderMultiChannel"));
  EXPECT_TRUE(value("cryptomatte/1a2b3c/name"));
  EXPECT_TRUE(value("cryptomatte/1a2b3c/manifest"));
  EXPECT_FALSE(value("cryptomatte/4d5e6f/name"));
}

TEST(WriteExr, PassThroughIsBitExact) {
  TemporaryDirectory directory;
  const Box2i window({-2, 4}, {5, 9});
  const std::vector<float> pixels = noise(48);
  std::vector<uint32_t> ids(48), float_bits(48);
  std::vector<uint16_t> half_bits(12);
  for (uint32_t i = 0; i < 48; ++i) {
    ids[i] = 0xffffffffu - i * 77777777u;
    float_bits[i] = i == 3   ? 0x7fc12345u
                    : i == 4 ? 0xff800001u
                             : i * 90000001u;  // two kinds of NaN among them
  }
  for (uint16_t i = 0; i < 12; ++i) half_bits[i] = uint16_t(i == 5 ? 0x7e01 : 0x3c00 + i);
  ExrOutput output;
  output.source = Imf::Header(Box2i({0, 0}, {9, 9}), window);
  output.planes = {{"R", Imf::HALF, pixels.data()}};
  output.pass_through = {raw_channel("id", Imf::UINT, window, ids),
                         raw_channel("crypto", Imf::FLOAT, window, float_bits),
                         raw_channel("RY", Imf::HALF, window, half_bits, 2)};
  for (const auto compression : {Imf::NO_COMPRESSION, Imf::RLE_COMPRESSION, Imf::ZIPS_COMPRESSION,
                                 Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION}) {
    output.compression = compression;
    write_exr(directory / "a.exr", output);
    ExrFile file(directory / "a.exr");
    for (const ExrRawChannel& expected : output.pass_through) {
      const ExrRawChannel read = file.read_raw(expected.name);
      EXPECT_EQ(read.type, expected.type);
      EXPECT_EQ(read.x_sampling, expected.x_sampling);
      EXPECT_EQ(read.data_window, window);
      EXPECT_EQ(read.bytes, expected.bytes) << expected.name << " by compression " << compression;
    }
  }
}

TEST(WriteExr, RefusesWhatWouldAlterOrConfuseChannels) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = noise(4);
  ExrOutput output = rgb_output(pixels, 2, 2);
  const Box2i window = output.source.dataWindow();
  output.pass_through = {raw_channel("id", Imf::UINT, window, std::vector<uint32_t>(4))};
  for (const auto compression : {Imf::PXR24_COMPRESSION, Imf::B44_COMPRESSION, Imf::B44A_COMPRESSION,
                                 Imf::DWAA_COMPRESSION, Imf::DWAB_COMPRESSION}) {
    output.compression = compression;
    EXPECT_ERROR(write_exr(directory / "a.exr", output), "a.exr", "'id'", "lossless");
  }
  output.compression = Imf::ZIP_COMPRESSION;
  output.pass_through[0].name = "R";
  EXPECT_ERROR(write_exr(directory / "a.exr", output), "a.exr", "two channels 'R'");
  output.pass_through = {raw_channel("id", Imf::UINT, Box2i({1, 1}, {2, 2}), std::vector<uint32_t>(4))};
  EXPECT_ERROR(write_exr(directory / "a.exr", output), "'id'", "needs the data window of the output");
  output.pass_through.clear();
  output.planes[0].type = Imf::UINT;
  EXPECT_ERROR(write_exr(directory / "a.exr", output), "'R'", "uint");
  EXPECT_EQ(files_in(directory.path()), Names{});
}

// The disk fills up in the header, in the pixels or in the buffer's last bytes.
TEST(WriteExr, AFullDiskLeavesTheOldFileAndNothingElse) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = noise(200 * 100);
  const ExrOutput output = rgb_output(pixels, 200, 100);
  write_exr(directory / "whole.exr", output);
  const size_t whole = fs::file_size(directory / "whole.exr");
  fs::remove(directory / "whole.exr");
  test::write_file(directory / "a.exr", "the old file");
  for (size_t limit : {size_t(0), size_t(1), size_t(300), whole / 2, whole - 5000, whole - 1}) {
    SCOPED_TRACE(limit);
    std::string message;
    {
      const FileSizeLimit full(limit);
      message = test::error_of([&] { write_exr(directory / "a.exr", output); });
    }
    EXPECT_TRUE(test::contains(message, "a.exr") && test::contains(message, "File too large")) << message;
    EXPECT_EQ(files_in(directory.path()), Names{"a.exr"});
    EXPECT_EQ(test::read_file(directory / "a.exr"), "the old file");
  }
  const FileSizeLimit enough(whole);
  EXPECT_EQ(write_exr(directory / "a.exr", output), 0u);
}

TEST(WriteExr, TargetsThatCannotBeWritten) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = noise(4);
  const ExrOutput output = rgb_output(pixels, 2, 2);
  EXPECT_ERROR(write_exr(directory.path(), output), directory.path().string(), "it is a folder");
  EXPECT_ERROR(write_exr(directory / "none" / "a.exr", output), "none/a.exr", "No such file or directory");
  EXPECT_ERROR(write_exr("/dev/null", output), "/dev/null", "not a regular file");
  EXPECT_EQ(files_in(directory.path()), Names{});
  ASSERT_EQ(chmod(directory.path().c_str(), 0555), 0);
  const bool is_root = geteuid() == 0;  // root may write everywhere
  ASSERT_EQ(is_root ? seteuid(65534) : 0, 0);
  EXPECT_ERROR(write_exr(directory / "a.exr", output), "a.exr", "Permission denied");
  ASSERT_EQ(is_root ? seteuid(0) : 0, 0);
  EXPECT_EQ(files_in(directory.path()), Names{});
  ASSERT_EQ(chmod(directory.path().c_str(), 0755), 0);
}

TEST(WriteExr, FollowsALinkAndHonoursTheUmask) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = noise(4);
  test::write_file(directory / "real.exr", "old");
  fs::create_symlink("real.exr", directory / "link.exr");
  const mode_t before = umask(027);
  write_exr(directory / "link.exr", rgb_output(pixels, 2, 2));
  umask(before);
  EXPECT_TRUE(fs::is_symlink(directory / "link.exr"));
  EXPECT_EQ(ExrFile(directory / "real.exr").channels().size(), 3u);
  EXPECT_EQ(fs::status(directory / "real.exr").permissions(), fs::perms(0640));
}

TEST(WriteExr, ANameWithoutAFolder) {
  TemporaryDirectory directory;
  const fs::path before = fs::current_path();
  fs::current_path(directory.path());
  const std::vector<float> pixels = noise(4);
  write_exr("a.exr", rgb_output(pixels, 2, 2));
  fs::current_path(before);
  EXPECT_EQ(files_in(directory.path()), Names{"a.exr"});
}

TEST(WriteExr, OiiotoolReadsIt) {
  TemporaryDirectory directory;
  const std::vector<float> pixels = {0.5f, 1, 2, 4};
  ExrOutput output;
  output.source = Imf::Header(Box2i({0, 0}, {7, 7}), Box2i({-1, 3}, {0, 4}));
  output.planes = {{"R", Imf::HALF, pixels.data()}, {"ViewLayer.Deep Dir.G", Imf::FLOAT, pixels.data()}};
  output.pass_through = {
      raw_channel("id", Imf::UINT, output.source.dataWindow(), std::vector<uint32_t>{1, 2, 3, 4000000000u})};
  write_exr(directory / "a.exr", output);
  const auto result =
      test::run_process({"oiiotool", "--info", "-v", "--dumpdata", (directory / "a.exr").string()});
  ASSERT_EQ(result.exit_status, 0) << result.err;
  for (const std::string part :
       {"R (half)", "ViewLayer.Deep Dir.G (float)", "id (uint)", "pixel data origin: x=-1, y=3",
        "full/display size: 8 x 8", "compression: \"zip\""})
    EXPECT_TRUE(test::contains(result.out, part)) << result.out << "\nlacks " << part;
}

TEST(WriteExr, HeadersOfDegradedImages) {
  const Imf::Header low =
      degraded_header(Imf::Header(Box2i({0, 0}, {1919, 1079}), Box2i({-8, -3}, {1927, 1084})), 8);
  EXPECT_EQ(low.displayWindow(), Box2i({0, 0}, {239, 134}));
  EXPECT_EQ(low.dataWindow(), Box2i({-1, -1}, {240, 134}));
  const Imf::Header same = degraded_header(Imf::Header(16, 8), 1);
  EXPECT_EQ(same.dataWindow(), Box2i({0, 0}, {15, 7}));
}

}  // namespace
}  // namespace raymeld
