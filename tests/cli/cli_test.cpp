#include <OpenEXR/ImfStringAttribute.h>
#include <fmt/format.h>
#include <png.h>

#include <cmath>
#include <cstring>
#include <fstream>

#include "cli_fixture.h"
#include "gpu.h"
#include "io/png.h"
#include "io/safetensors.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

std::string attribute(const ExrFile& file, const std::string& name) {
  const auto* value = file.header().findTypedAttribute<Imf::StringAttribute>(name);
  return value ? value->value() : "";
}

Picture read_png(const fs::path& path) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png_image_begin_read_from_file(&png, path.c_str());
  png.format = PNG_FORMAT_RGB;
  Picture picture{.width = int(png.width), .height = int(png.height), .rgb = {}};
  picture.rgb.resize(PNG_IMAGE_SIZE(png));
  png_image_finish_read(&png, nullptr, picture.rgb.data(), 0, nullptr);
  EXPECT_EQ(PNG_IMAGE_FAILED(png), 0u) << png.message;
  return picture;
}

// Returns whether the top left corner has only black and white, and both, as a label has.
bool has_label(const Picture& picture, int left) {
  std::set<int> values;
  for (int y = 0; y < 7; ++y)
    for (int x = left; x < left + 20; ++x)
      for (int c = 0; c < 3; ++c) values.insert(picture.rgb[size_t(3 * (y * picture.width + x) + c)]);
  return values == std::set<int>{0, 255};
}

// Returns the values of a NumPy file, whose header must hold `shape`.
std::vector<float> read_npy(const fs::path& path, const std::string& shape) {
  const std::string bytes = read_file(path);
  const size_t header = uint8_t(bytes.at(8)) + 256u * uint8_t(bytes.at(9));
  EXPECT_EQ(bytes.substr(0, 8), std::string("\x93NUMPY\x01\x00", 8));
  EXPECT_EQ((10 + header) % 64, 0u);
  EXPECT_NE(bytes.substr(10, header).find("'descr': '<f4', 'fortran_order': False, 'shape': " + shape),
            std::string::npos);
  std::vector<float> values((bytes.size() - 10 - header) / sizeof(float));
  std::memcpy(values.data(), bytes.data() + 10 + header, values.size() * sizeof(float));
  return values;
}

TEST_F(Cli, HelpAndVersion) {
  EXPECT_EQ(run({"--version"}).out.substr(0, 8), "raymeld ");
  const ProcessResult help = run({"--help"});
  EXPECT_EQ(help.exit_status, 0);
  for (const char* command :
       {"fuse", "denoise", "upscale", "devices", "compare", "degrade", "graph", "tune", "conform"}) {
    EXPECT_NE(help.out.find(command), std::string::npos);
    const ProcessResult its_help = run({command, "--help"});
    EXPECT_EQ(its_help.exit_status, 0);
    EXPECT_NE(its_help.out.find("--help"), std::string::npos);
  }
}

TEST_F(Cli, DevicesAreListed) {
  const Json devices = run_json({"devices", "--json"}).at("devices");
  ASSERT_GE(devices.size(), 1u);
  const std::string text = run({"devices"}).out;
  for (const Json& device : devices) {
    EXPECT_NE(text.find(device.at("name").get<std::string>()), std::string::npos);
    EXPECT_NE(text.find(device.at("uuid").get<std::string>()), std::string::npos);
    EXPECT_GT(device.at("max_binding_bytes").get<uint64_t>(), 0u);
  }
}

TEST_F(Cli, FuseWritesAndReportsAllThatIsAskedFor) {
  write_image(folder_ / "truth.exr", kColorNames, random_image(kColorNames, 32, 24, 3));
  const Json json = run_json(
      fuse({"--reference", "truth.exr", "--preview", "fused.png", "--preview-before-after", "all.png",
            "--dump", "layers/", "--profile", "--output-type", "float", "--precision", "fp32", "--json"}));
  for (const char* key : {"device_ms", "total_ms", "peak_bytes", "tiles"}) EXPECT_GT(json.at(key), 0) << key;
  EXPECT_GE(json.at("total_ms"), json.at("device_ms"));
  EXPECT_EQ(json.at("model"), "tiny-x4");
  EXPECT_EQ(json.at("precision"), "fp32");
  EXPECT_EQ(json.at("scale"), 4);
  EXPECT_EQ(json.at("warnings"), Json::array());
  EXPECT_EQ(json.at("layers").front().at("name"), "encode.lrhs");

  const Image fused = read("out.exr");
  EXPECT_EQ(read_npy(folder_ / "layers/decode.npy", "(3, 24, 32)"), fused.data);
  EXPECT_EQ(read_npy(folder_ / "layers/lrhs.npy", "(5, 6, 8)").size(), 5u * 6 * 8);
  const Picture preview = read_png(folder_ / "fused.png"), all = read_png(folder_ / "all.png");
  EXPECT_EQ(std::pair(preview.width, preview.height), std::pair(32, 24));
  EXPECT_EQ(std::pair(all.width, all.height), std::pair(4 * 32 + 3 * 4, 24));
  EXPECT_FALSE(has_label(preview, 0));
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(has_label(all, i * (32 + 4))) << i;
  for (const auto& [row, image] : {std::pair{"fused", "out.exr"}, std::pair{"hrls", "high.exr"}}) {
    const Json quality = run_json({"compare", image, "truth.exr", "--json"});
    for (const char* key : {"psnr_db", "relmse_bcr", "relmse_gharbi"})
      EXPECT_NEAR(json.at("metrics").at(row).at(key), quality.at(key), 1e-9) << row << " " << key;
  }
  EXPECT_GT(json.at("metrics").at("bicubic_lrhs").at("psnr_db"), 0);
  EXPECT_EQ(files(), (std::set<std::string>{"low.exr", "high.exr", "truth.exr", "out.exr", "fused.png",
                                            "all.png", "layers"}));
}

TEST_F(Cli, OutputIsOfTheHrlsKind) {
  const ProcessResult result = run(fuse());
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_EQ(result.out, "");
  ExrFile hrls(folder_ / "high.exr"), fused(folder_ / "out.exr");
  EXPECT_EQ(fused.channel_names(), (std::vector<std::string>{"A", "B", "G", "R"}));
  EXPECT_EQ(fused.channel("R").type, Imf::HALF);
  EXPECT_EQ(fused.read_raw("A").bytes, hrls.read_raw("A").bytes);
  EXPECT_EQ(attribute(fused, "raymeldModel"), "tiny-x4 version 1");
}

TEST_F(Cli, KeepLayersPassesThemBitByBit) {
  const ProcessResult result = run(fuse({"--keep-layers", "--quiet"}));
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_EQ(result.err, "");
  ExrFile hrls(folder_ / "high.exr"), fused(folder_ / "out.exr");
  EXPECT_EQ(fused.channel_names(), hrls.channel_names());
  for (const std::string& name : hrls.channel_names()) {
    const bool same = fused.read_raw(name).bytes == hrls.read_raw(name).bytes;
    EXPECT_EQ(same, name.size() != 1 || name == "A") << name;
  }
}

TEST_F(Cli, ModelsByNameAndByScale) {
  fs::create_directory(folder_ / "models");
  environment_["RAYMELD_MODELS"] = (folder_ / "models").string();
  fs::copy_file(tiny_model(), folder_ / "models/x4-fast.safetensors");
  const std::vector<std::string> dry = {"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "--dry-run"};
  const auto with_model = [&](const std::string& model) {
    std::vector<std::string> arguments = dry;
    arguments.insert(arguments.end(), {"--model", model, "--json"});
    return run_json(arguments).at("model");
  };
  EXPECT_EQ(with_model("x4-fast"), "tiny-x4");
  // The balanced model of a scale is the default; this file cannot be read.
  write_file(folder_ / "models/x4-balanced.safetensors", "");
  const ProcessResult result = run(dry);
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("x4-balanced.safetensors"), std::string::npos) << result.err;
  fs::copy_file(tiny_model(), folder_ / "models/x4-balanced.safetensors",
                fs::copy_options::overwrite_existing);
  EXPECT_EQ(run_json({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "--dry-run", "--json"}).at("scale"),
            4);
  EXPECT_EQ(with_model("x4"), "tiny-x4");
}

TEST_F(Cli, DryRunShowsThePlanAndWritesNothing) {
  const std::set<std::string> before = files();
  const ProcessResult result = run(fuse({"--dry-run"}));
  EXPECT_EQ(result.exit_status, 0) << result.err;
  for (const char* text : {"normal.X", "1 tile(s) of 8 x 6", "halo", "GFLOP", "without aliasing"})
    EXPECT_NE(result.out.find(text), std::string::npos) << text << " in " << result.out;
  EXPECT_EQ(files(), before);
}

// Only the LRHS pixels that the data window touches are fused.
TEST_F(Cli, DataWindowsInsideTheDisplayWindow) {
  const Image cut = random_image(kLayeredNames, 15, 14, 4);
  write_image(folder_ / "cut.exr", kLayeredNames, cut, window(5, 3, 15, 14), window(0, 0, 32, 24));
  Image padded(16, 20, cut.channels);  // starts at pixel (4, 0)
  for (int c = 0; c < padded.channels; ++c)
    for (int y = 0; y < padded.height; ++y)
      for (int x = 0; x < padded.width; ++x)
        padded.at(c, y, x) = cut.at(c, std::clamp(y - 3, 0, 13), std::clamp(x - 1, 0, 14));
  write_image(folder_ / "padded.exr", kLayeredNames, padded);
  write_image(folder_ / "cropped.exr", kColorNames, crop(read("low.exr"), 1, 0, 4, 5));
  const auto fuse_to = [&](const std::string& lrhs, const std::string& hrls, const std::string& output) {
    return run_json(
        {"fuse", "--lrhs", lrhs, "--hrls", hrls, "-o", output, "--model", tiny_model(), "--json"});
  };
  const Json json = fuse_to("low.exr", "cut.exr", "a.exr");
  EXPECT_EQ(json.at("peak_bytes"), fuse_to("cropped.exr", "padded.exr", "b.exr").at("peak_bytes"));
  EXPECT_EQ(json.at("warnings"), Json::array());
  EXPECT_EQ(ExrFile(folder_ / "a.exr").header().dataWindow(), window(5, 3, 15, 14));
  EXPECT_EQ(ExrFile(folder_ / "a.exr").header().displayWindow(), window(0, 0, 32, 24));
  EXPECT_EQ(read("a.exr").data, crop(read("b.exr"), 1, 3, 15, 14).data);
}

TEST_F(Cli, LrhsIsRepeatedWhereItHasNoData) {
  const Image low = read("low.exr");
  write_image(folder_ / "cut.exr", kColorNames, crop(low, 0, 0, 7, 6), window(0, 0, 7, 6),
              window(0, 0, 8, 6));
  Image repeated = low;
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < 6; ++y) repeated.at(c, y, 7) = low.at(c, y, 6);
  write_image(folder_ / "low.exr", kColorNames, repeated);
  run_json(fuse({"--json"}));
  const Image expected = read("out.exr");
  const Json warnings = run_json({"fuse", "--lrhs", "cut.exr", "--hrls", "high.exr", "-o", "out.exr",
                                  "--model", tiny_model(), "--json"})
                            .at("warnings");
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0].at("count"), 6);
  EXPECT_EQ(read("out.exr").data, expected.data);
}

TEST_F(Cli, MapOfHrlsDoesNotConcernAPlainLrhs) {
  std::vector<std::string> names;
  for (const char* pass : {"Combined", "Denoising Normal", "Denoising Albedo"})
    for (const std::string& color : kColorNames) names.push_back(fmt::format("Left.{}.{}", pass, color));
  write_image(folder_ / "high.exr", names, random_image(names, 32, 24, 2));
  write_image(folder_ / "truth.exr", kColorNames, random_image(kColorNames, 32, 24, 3));
  for (const char* item : {"viewlayer=Left", "color=Left.Combined", "cycles"}) {
    const Json json = run_json(fuse({"--map", item, "--reference", "truth.exr", "--dry-run", "--json"}));
    EXPECT_EQ(json.at("layers").at("lrhs").at("color").at("channels"), Json({{"R", "G", "B"}}));
    EXPECT_EQ(json.at("layers").at("hrls").at("color").at("channels").at(0).at(0), "Left.Combined.R");
    EXPECT_EQ(json.at("layers").at("hrls").at("variance").at("rule"), "variance");
  }
}

TEST_F(Cli, TilesGiveTheSameBits) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 48, 33, 5));
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 192, 132, 6));
  EXPECT_EQ(run_json(fuse({"--json", "--kernels", "direct"})).at("tiles"), 1);
  const Image whole = read("out.exr");
  const Json tiled = run_json(fuse({"--json", "--max-memory", "1", "--kernels", "direct"}));
  EXPECT_GT(tiled.at("tiles"), 1);
  EXPECT_LE(tiled.at("peak_bytes"), 1 << 20);
  EXPECT_EQ(read("out.exr").data, whole.data);
}

TEST_F(Cli, HalfPrecisionIsSaidAndUsed) {
  const bool has_it = run_json({"devices", "--json"}).at("devices").at(0).at("storage_16bit");
  const ProcessResult result = run(fuse({"--json", "--precision", "fp16", "--device", "0"}));
  ASSERT_EQ(result.exit_status, has_it ? 0 : 2) << result.err;
  if (!has_it) {
    EXPECT_NE(result.err.find("--precision fp32"), std::string::npos) << result.err;
    return;
  }
  EXPECT_EQ(Json::parse(result.out).at("precision"), "fp16");
  const Image half = read("out.exr");
  EXPECT_EQ(run(fuse({"--precision", "fp32"})).exit_status, 0);
  EXPECT_NE(read("out.exr").data, half.data);
}

// Weights that are valid may still make values that fp16 cannot hold, or values that are not finite.
TEST_F(Cli, SaturationIsCountedAndNoImageIsMadeOfInfinities) {
  SafeTensors model = read_safetensors(tiny_model());
  const auto fuse_changed = [&](const char* tensor, float value, std::vector<std::string> options) {
    SafeTensors changed = model;
    for (float& v : changed.tensors.at(tensor).values) v = value;
    write_safetensors(folder_ / "scaled.safetensors", changed);
    std::vector<std::string> command{"fuse",
                                     "--lrhs",
                                     "low.exr",
                                     "--hrls",
                                     "high.exr",
                                     "-o",
                                     "out.exr",
                                     "--model",
                                     "scaled.safetensors",
                                     "--device",
                                     "0",
                                     "--json",
                                     "--input-exposure",
                                     "4"};
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  };
  const ProcessResult single = fuse_changed("rec.bias", 1e5f, {"--precision", "fp32"});
  ASSERT_EQ(single.exit_status, 0) << single.err;
  EXPECT_EQ(Json::parse(single.out).at("warnings"), Json::array());
  const Image expected = read("out.exr");
  fs::remove(folder_ / "out.exr");
  if (run_json({"devices", "--json"}).at("devices").at(0).at("storage_16bit")) {
    const ProcessResult half = fuse_changed("rec.bias", 1e5f, {"--precision", "fp16"});
    EXPECT_EQ(half.exit_status, 2);
    EXPECT_NE(half.err.find("65504"), std::string::npos) << half.err;
    EXPECT_FALSE(fs::exists(folder_ / "out.exr"));
    const ProcessResult warned =
        fuse_changed("rec.bias", 1e5f, {"--precision", "fp16", "--overflow", "warn"});
    ASSERT_EQ(warned.exit_status, 0) << warned.err;
    EXPECT_GT(Json::parse(warned.out).at("warnings").at(0).at("count"), 0);
    const ProcessResult again = fuse_changed("rec.bias", 1e5f, {"--precision", "fp16", "--overflow", "redo"});
    ASSERT_EQ(again.exit_status, 0) << again.err;
    const Json redone = Json::parse(again.out);
    EXPECT_EQ(redone.at("redone_tiles"), redone.at("tiles"));
    EXPECT_EQ(redone.at("precision"), "fp32");
    EXPECT_EQ(attribute(ExrFile(folder_ / "out.exr"), "raymeldPrecision"), "fp32");
    EXPECT_EQ(redone.at("warnings").at(0).at("count"), redone.at("tiles"));
    EXPECT_EQ(read("out.exr").data, expected.data);
    fs::remove(folder_ / "out.exr");
  }
  const ProcessResult infinite = fuse_changed("lrhs.weight", 3e38f, {"--precision", "fp32"});
  EXPECT_EQ(infinite.exit_status, 2);
  EXPECT_NE(infinite.err.find("not finite"), std::string::npos) << infinite.err;
  EXPECT_EQ(files(), (std::set<std::string>{"low.exr", "high.exr", "scaled.safetensors"}));
}

// The bar on a terminal is wiped before anything else is written in its line.
TEST_F(Cli, WarningsDoNotStandInTheProgressBar) {
  if (!run_json({"devices", "--json"}).at("devices").at(0).at("storage_16bit"))
    GTEST_SKIP() << "no 16-bit storage";
  SafeTensors model = read_safetensors(tiny_model());
  model.tensors.at("rec.bias").values.assign(3, 1e5f);
  write_safetensors(folder_ / "large.safetensors", model);
  const std::string command = RAYMELD_PROGRAM
      " fuse --lrhs low.exr --hrls high.exr -o out.exr --model ./large.safetensors --device 0"
      " --input-exposure 4 --precision fp16 --overflow warn";
  const ProcessResult result = run_process({"script", "-qec", command, "/dev/null"},
                                           {.directory = folder_.path(), .environment = environment_});
  ASSERT_EQ(result.exit_status, 0) << result.out << result.err;
  EXPECT_NE(result.out.find("100 %\r\033[Kraymeld: warning: "), std::string::npos) << result.out;
}

TEST_F(Cli, NanAndInfAreCountedAndReplaced) {
  Image high = random_image(kLayeredNames, 32, 24, 2);
  high.at(0, 3, 4) = high.at(7, 9, 9) = NAN;
  high.at(1, 0, 0) = high.at(1, 23, 31) = INFINITY;
  high.at(2, 5, 5) = -INFINITY;
  write_image(folder_ / "high.exr", kLayeredNames, high, Imf::FLOAT);
  const Json warnings = run_json(fuse({"--json"})).at("warnings");
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_EQ(warnings[0].at("count"), 2);
  EXPECT_EQ(warnings[1].at("count"), 3);
  for (const Json& warning : warnings)
    EXPECT_NE(warning.at("message").get<std::string>().find("high.exr"), std::string::npos);
  for (float value : read("out.exr").data) ASSERT_TRUE(std::isfinite(value));
}

TEST_F(Cli, NanInAlphaIsCountedAndReplaced) {
  for (const Imf::PixelType type : {Imf::HALF, Imf::FLOAT}) {
    Image high = random_image(kLayeredNames, 32, 24, 2);
    high.at(9, 3, 4) = high.at(9, 9, 9) = NAN;
    if (type == Imf::FLOAT) high.at(9, 0, 0) = -INFINITY;  // write_exr() has no infinite half
    write_image(folder_ / "high.exr", kLayeredNames, high, type);
    const Json warnings = run_json(fuse({"--json"})).at("warnings");
    ASSERT_EQ(warnings.size(), type == Imf::FLOAT ? 2u : 1u);
    EXPECT_EQ(warnings[0].at("message"), "HRLS 'high.exr': 2 values of channel 'A' are NaN; written as 0");
    EXPECT_EQ(warnings[0].at("count"), 2);
    if (type == Imf::FLOAT) {
      EXPECT_EQ(warnings[1].at("message"),
                "HRLS 'high.exr': 1 values of channel 'A' are infinite; written as +-65504");
    }
    const Image alpha = read("out.exr", {"A"}), before = read("high.exr", {"A"});
    for (size_t i = 0; i < alpha.data.size(); ++i) {
      const float expected = std::isnan(before.data[i]) ? 0 : std::clamp(before.data[i], -65504.0f, 65504.0f);
      EXPECT_EQ(alpha.data[i], expected);
    }
    const Json kept = run_json(fuse({"--json", "--keep-layers"})).at("warnings");
    ASSERT_EQ(kept.size(), 1u);
    EXPECT_EQ(kept[0].at("message"), "HRLS 'high.exr': 2 values of channel 'A' are NaN; written as they are");
    EXPECT_EQ(ExrFile(folder_ / "out.exr").read_raw("A").bytes,
              ExrFile(folder_ / "high.exr").read_raw("A").bytes);
  }
}

TEST_F(Cli, DegradeKeepsEveryFourthPixelOfEachType) {
  const Image image = random_image({"R", "G", "B"}, 32, 24, 7);
  ExrOutput output;
  output.source = Imf::Header(window(0, 0, 32, 24), window(0, 0, 32, 24));
  for (int c = 0; c < 3; ++c) output.planes.push_back({kColorNames[c], Imf::FLOAT, image.plane(c)});
  ExrRawChannel id{.name = "id",
                   .type = Imf::UINT,
                   .data_window = window(0, 0, 32, 24),
                   .bytes = std::vector<char>(32 * 24 * 4)};
  for (size_t i = 0; i < id.bytes.size(); ++i) id.bytes[i] = char(i * 7 + i / 256);
  output.pass_through.push_back(id);
  write_exr(folder_ / "full.exr", output);
  const ProcessResult result = run({"degrade", "full.exr", "--scale", "4", "-o", "small.exr"});
  ASSERT_EQ(result.exit_status, 0) << result.err;

  EXPECT_EQ(read("small.exr").data, degrade_nearest(image, 4).data);
  ExrFile small(folder_ / "small.exr");
  EXPECT_EQ(attribute(small, "raymeldSampling"), "nearest");
  EXPECT_EQ(small.header().displayWindow(), window(0, 0, 8, 6));
  const ExrRawChannel low = small.read_raw("id");
  ASSERT_EQ(low.type, Imf::UINT);
  for (size_t y = 0; y < 6; ++y)
    for (size_t x = 0; x < 8; ++x)
      EXPECT_EQ(std::memcmp(&low.bytes[(y * 8 + x) * 4], &id.bytes[(y * 4 * 32 + x * 4) * 4], 4), 0);
}

TEST_F(Cli, SamplingIsWhatTheUserOrTheFileSays) {
  const auto sampling = [&](const std::string& lrhs, const std::string& wanted) {
    return run_json({"fuse", "--lrhs", lrhs, "--hrls", "high.exr", "--model", tiny_model(), "--dry-run",
                     "--json", "--lrhs-sampling", wanted})
        .at("lrhs_sampling");
  };
  ASSERT_EQ(run({"degrade", "high.exr", "--scale", "4", "-o", "degraded.exr"}).exit_status, 0);
  EXPECT_EQ(sampling("degraded.exr", "auto"), "nearest");
  EXPECT_EQ(sampling("degraded.exr", "centered"), "centered");
  EXPECT_EQ(sampling("low.exr", "auto"), "centered");
  EXPECT_EQ(sampling("low.exr", "nearest"), "nearest");
}

TEST_F(Cli, WhatAModelWasNotTrainedOnIsSaid) {
  const auto notices = [&](const std::string& model, const std::string& sampling) {
    return run({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "--model", model, "--dry-run",
                "--lrhs-sampling", sampling})
        .out;
  };
  const std::string both = source_path("tests/golden/guided-x4.safetensors").string();
  EXPECT_NE(notices(tiny_model(), "centered").find("tiny-x4 was not trained on centered LRHS"),
            std::string::npos);
  EXPECT_EQ(notices(tiny_model(), "nearest").find("not trained"), std::string::npos);
  for (const char* sampling : {"nearest", "centered"})
    EXPECT_EQ(notices(both, sampling).find("not trained"), std::string::npos);
}

// The model takes color, albedo, normal and variance, and can do without albedo and variance.
TEST_F(Cli, LayersThatTheModelDoesWithoutAreZero) {
  const std::string model = source_path("tests/golden/guided-x4.safetensors").string();
  std::vector<std::string> names = kLayeredNames;
  Image image = read("high.exr", names);
  for (int c = 6; c < 9; ++c) std::fill_n(image.plane(c), image.plane_size(), 0.0f);
  write_image(folder_ / "zero.exr", names, image);
  names.erase(names.begin() + 6, names.begin() + 9);
  std::copy_n(image.plane(9), image.plane_size(), image.plane(6));
  write_image(folder_ / "none.exr", names, image);
  const auto fuse_hrls = [&](const std::string& hrls, const std::string& output, const char* how) {
    return run({"fuse", "--lrhs", "low.exr", "--hrls", hrls, "-o", output, "--model", model, how});
  };
  EXPECT_EQ(Json::parse(fuse_hrls("zero.exr", "a.exr", "--json").out).at("absent_layers"), Json::array());
  EXPECT_EQ(Json::parse(fuse_hrls("none.exr", "b.exr", "--json").out).at("absent_layers"), Json({"albedo"}));
  EXPECT_EQ(read("b.exr").data, read("a.exr").data);
  for (const char* how : {"--keep-layers", "--dry-run"}) {
    const ProcessResult result = fuse_hrls("none.exr", "b.exr", how);
    EXPECT_NE((result.out + result.err).find("; no albedo"), std::string::npos) << result.err;
  }
  names.erase(names.begin() + 3, names.begin() + 6);
  write_image(folder_ / "none.exr", names, image);
  const ProcessResult result = fuse_hrls("none.exr", "c.exr", "--json");
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("normal: looked for"), std::string::npos) << result.err;
  EXPECT_EQ(result.err.find("albedo: looked for"), std::string::npos) << result.err;
}

// The guides' file has a color of its own, which is not read, and lacks what HRLS must have.
TEST_F(Cli, GuidesMayComeFromAFileOfTheirOwn) {
  const std::string model = source_path("tests/golden/guided-x4.safetensors").string();
  const Image high = read("high.exr", kLayeredNames);
  const std::vector<std::string> guide_names(kLayeredNames.begin(), kLayeredNames.begin() + 9);
  const Image guides = random_image(guide_names, high.width, high.height, 77);
  write_image(folder_ / "guides.exr", guide_names, guides);
  Image replaced = high;
  std::copy_n(guides.plane(3), 6 * guides.plane_size(), replaced.plane(3));
  write_image(folder_ / "replaced.exr", kLayeredNames, replaced);
  const auto fuse_to = [&](const std::string& output, std::vector<std::string> more) {
    more.insert(more.begin(), {"fuse", "--lrhs", "low.exr", "-o", output, "--model", model});
    return run(more);
  };
  EXPECT_EQ(fuse_to("a.exr", {"--hrls", "replaced.exr"}).exit_status, 0);
  const ProcessResult with = fuse_to("b.exr", {"--hrls", "high.exr", "--guides", "guides.exr", "--verbose"});
  EXPECT_EQ(with.exit_status, 0) << with.err;
  EXPECT_NE(with.err.find("guides guides.exr: "), std::string::npos) << with.err;
  EXPECT_EQ(read("b.exr").data, read("a.exr").data);

  const auto expect_error = [&](const std::string& file, const std::string& text) {
    const ProcessResult refused = fuse_to("c.exr", {"--hrls", "high.exr", "--guides", file});
    EXPECT_NE(refused.exit_status, 0);
    EXPECT_NE(refused.err.find(text), std::string::npos) << refused.err;
    EXPECT_FALSE(fs::exists(folder_ / "c.exr"));
  };
  expect_error("low.exr", "neither albedo nor normal");
  expect_error("nothing.exr", "nothing.exr");
  write_image(folder_ / "small.exr", guide_names, crop(guides, 0, 0, 8, 8));
  expect_error("small.exr", "the sizes must be equal");
}

TEST_F(Cli, InputExposureIsFoundOrGiven) {
  const std::string model = source_path("tests/golden/guided-x4.safetensors").string();
  const auto exposure = [&](const std::string& of, std::vector<std::string> more) {
    more.insert(more.begin(), {"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "out.exr", "--model",
                               of, "--json", "--output-type", "float"});
    return run_json(more).at("input_exposure").get<double>();
  };
  double sum = 0;
  const Image low = read("low.exr");
  for (size_t i = 0; i < low.plane_size(); ++i)
    sum += std::sqrt(0.2126 * low.plane(0)[i] + 0.7152 * low.plane(1)[i] + 0.0722 * low.plane(2)[i]);
  const double expected = 0.2 / std::pow(sum / double(low.plane_size()), 2);
  EXPECT_NEAR(exposure(model, {"--dry-run"}), expected, 1e-6);
  EXPECT_NEAR(exposure(model, {}), expected, 1e-6);
  const Image fused = read("out.exr");
  EXPECT_EQ(exposure(model, {"--input-exposure", "off"}), 1);
  EXPECT_NE(read("out.exr").data, fused.data);
  EXPECT_EQ(exposure(model, {"--input-exposure", "0.125"}), 0.125);
  EXPECT_EQ(exposure(tiny_model(), {}), 1);
  EXPECT_EQ(exposure(tiny_model(), {"--input-exposure", "4", "--dry-run"}), 4);
  EXPECT_NE(run(fuse({"--dry-run", "--input-exposure", "4"})).out.find("input exposure 4"),
            std::string::npos);
}

TEST_F(Cli, CompareGivesThePapersMeasures) {
  Image quarter(8, 6, 3), half(8, 6, 3);
  std::ranges::fill(quarter.data, 0.25f);
  std::ranges::fill(half.data, 0.5f);
  write_image(folder_ / "quarter.exr", kColorNames, quarter);
  write_image(folder_ / "half.exr", kColorNames, half);
  const Json json = run_json({"compare", "quarter.exr", "half.exr", "--json", "--error-map", "map.png"});
  const auto srgb = [](double x) { return 1.055 * std::pow(x, 1 / 2.4) - 0.055; };
  EXPECT_NEAR(json.at("psnr_db"), -20 * std::log10(srgb(0.5) - srgb(0.25)), 1e-3);
  EXPECT_NEAR(json.at("relmse_bcr"), 0.5 * 0.0625 / (0.25 + 0.01), 1e-9);
  EXPECT_NEAR(json.at("relmse_gharbi"), 0.0625 / (0.25 + 1e-4), 1e-9);
  const Picture map = read_png(folder_ / "map.png");
  EXPECT_EQ(std::pair(map.width, map.height), std::pair(8, 6));
  EXPECT_EQ(run_json({"compare", "half.exr", "half.exr", "--json"}).at("relmse_bcr"), 0);
  half.at(1, 2, 3) = NAN;
  write_image(folder_ / "half.exr", kColorNames, half);
  const Json sanitized = run_json({"compare", "quarter.exr", "half.exr", "--json"});
  EXPECT_TRUE(sanitized.at("psnr_db").is_number());
  EXPECT_EQ(sanitized.at("warnings").at(0).at("count"), 1);
}

TEST_F(Cli, CompareHasFewDigitsAndTheNamesOfJson) {
  Image small(8, 6, 3), large(8, 6, 3);
  std::ranges::fill(small.data, 1e-30f);
  std::ranges::fill(large.data, 1e30f);
  write_image(folder_ / "small.exr", kColorNames, small, Imf::FLOAT);
  write_image(folder_ / "large.exr", kColorNames, large, Imf::FLOAT);
  const std::string table = run({"compare", "large.exr", "small.exr"}).out;
  Json json = run_json({"compare", "large.exr", "small.exr", "--json"});
  json.erase("warnings");
  for (const auto& [name, value] : json.items()) EXPECT_NE(table.find(name), std::string::npos) << table;
  std::istringstream words(table.substr(table.find('\n')));
  for (std::string word; words >> word;) EXPECT_LE(word.size(), 9u) << table;
}

// The cache folder is the test's own, so that nothing was measured before.
TEST_F(Cli, TuneMeasuresOnceAndFuseReadsIt) {
  const std::vector<std::string> tune{"tune",  "--model",     tiny_model(), "--size",
                                      "32x32", "--precision", "fp32",       "--json"};
  const Json first = run_json(tune), again = run_json(tune);
  EXPECT_GE(first.at("conv2d").size(), 8u);
  EXPECT_EQ(again, first);  // including the times
  const std::string file = first.at("file");
  EXPECT_EQ(file.substr(0, folder_.path().string().size()), folder_.path().string());
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 8, 8, 5));
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 32, 32, 6));
  EXPECT_EQ(run(fuse({"--precision", "fp32"})).exit_status, 0);
  const Image tuned = read("out.exr");
  std::ofstream(file) << "{";
  EXPECT_EQ(run(fuse({"--precision", "fp32"})).exit_status, 0);
  const Image untuned = read("out.exr");
  for (size_t i = 0; i < tuned.data.size(); ++i)
    EXPECT_NEAR(tuned.data[i], untuned.data[i], 1e-3 * (1 + untuned.data[i]));
}

TEST_F(Cli, TuneStopsInTimeAndLosesNothing) {
  std::vector<std::string> tune{"tune",        "--model", tiny_model(), "--size", "32x32",
                                "--precision", "fp32",    "--seconds",  "0"};
  const ProcessResult first = run(tune), second = run(tune);
  EXPECT_NE(first.err.find(" shapes are left"), std::string::npos) << first.err;
  EXPECT_EQ(std::ranges::count(first.out, '\n'), 1) << first.out;
  EXPECT_EQ(std::ranges::count(second.out, '\n'), 1) << second.out;
  EXPECT_NE(first.out.substr(0, 30), second.out.substr(0, 30));  // another shape
  tune.insert(tune.end(), {"--again", "--json"});
  EXPECT_EQ(run_json(tune).at("conv2d").size(), 2u);
}

TEST_F(Cli, TuneSaysWhenThereIsNothingToDo) {
  const std::vector<std::string> tune{"tune",  "--model",     tiny_model(), "--size",
                                      "32x32", "--precision", "fp32"};
  const ProcessResult first = run(tune);
  EXPECT_NE(first.err.find("measuring "), std::string::npos) << first.err;
  EXPECT_NE(first.err.find("; wrote "), std::string::npos) << first.err;
  const ProcessResult again = run(tune);
  EXPECT_EQ(again.err.find("nothing to measure: "), 0u) << again.err;
  for (const char* done : {"measuring", "wrote"})
    EXPECT_EQ(again.err.find(done), std::string::npos) << again.err;
}

TEST_F(Cli, KernelsAgree) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 9, 11, 5));
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 36, 44, 6));
  EXPECT_EQ(run(fuse({"--precision", "fp32", "--kernels", "auto"})).exit_status, 0);
  const Image fast = read("out.exr");
  EXPECT_EQ(run(fuse({"--precision", "fp32", "--kernels", "direct"})).exit_status, 0);
  const Image direct = read("out.exr");
  for (size_t i = 0; i < fast.data.size(); ++i)
    EXPECT_NEAR(fast.data[i], direct.data[i], 1e-3 * (1 + direct.data[i]));
}

TEST_F(Cli, GraphNeedsNoDevice) {
  environment_["VK_DRIVER_FILES"] = environment_["VK_ICD_FILENAMES"] = "/nonexistent.json";
  const ProcessResult text = run({"graph", "--model", tiny_model(), "--size", "64x48"});
  EXPECT_EQ(text.exit_status, 0) << text.err;
  for (const char* part : {"groups.1.blocks.0.dense.2", "12x16x5 + 12x16x6 -> 12x16x3", "| fuse", "barriers",
                           "peak with aliasing"})
    EXPECT_NE(text.out.find(part), std::string::npos) << part;
  const ProcessResult dot = run({"graph", "--model", tiny_model(), "--size", "64x48", "--dot"});
  EXPECT_EQ(dot.exit_status, 0) << dot.err;
  EXPECT_EQ(dot.out.substr(0, 7), "digraph");
  EXPECT_NE(dot.out.find("HRLS -> p1"), std::string::npos);
  EXPECT_EQ(dot.out.substr(dot.out.size() - 2), "}\n");
  SafeTensors named = read_safetensors(tiny_model());
  named.metadata["name"] = "a\"b\\";
  write_safetensors(folder_ / "named.safetensors", named);
  EXPECT_EQ(run({"graph", "--model", "named.safetensors", "--size", "64x48", "--dot"}).out.substr(0, 18),
            "digraph \"a\\\"b\\\\\" {");
}

// Every dispatch of a frame belongs to one of the kernels.
TEST_F(Cli, CompilesWhatAFrameRuns) {
  const std::vector<std::string> compile = {"compile", "--model",     tiny_model(), "--size",
                                            "32x24",   "--precision", "fp32"};
  std::vector<std::string> as_json = compile;
  as_json.push_back("--json");
  const Json json = run_json(as_json), plan = run_json(fuse({"--precision", "fp32", "--dry-run", "--json"}));
  double dispatches = 0, flop = 0;
  const std::string text = run(compile).out;
  for (const Json& kernel : json.at("kernels")) {
    EXPECT_GT(kernel.at("compile_ms"), 0) << kernel;
    EXPECT_GE(kernel.at("invocations"), 32) << kernel;
    EXPECT_NE(text.find(kernel.at("kernel").get<std::string>() + ", "), std::string::npos) << text;
    for (const Json& layer : kernel.at("layers")) {
      EXPECT_GT(layer.at("workgroups"), 0) << layer;
      EXPECT_NE(text.find(layer.at("name").get<std::string>()), std::string::npos) << text;
      dispatches += layer.at("dispatches").get<double>();
      flop += layer.at("flop").get<double>();
    }
  }
  EXPECT_GT(dispatches, 0);
  EXPECT_EQ(dispatches, json.at("dispatches"));
  EXPECT_NEAR(flop * 1e-9, plan.at("gflop"), 1e-9);
}

}  // namespace
}  // namespace raymeld::test
