// Tests parts of frames: `fuse --window`, and data windows smaller than the display window.
#include <fmt/format.h>

#include "cli_fixture.h"
#include "io/exr_window.h"

namespace raymeld::test {
namespace {

using Imath::Box2i;
using Json = nlohmann::json;

std::string text_of(const Box2i& part) {
  return fmt::format("{},{},{},{}", part.min.x, part.min.y, width_of(part), height_of(part));
}

// Writes an x4 pair of 64 x 48 and 256 x 192 pixels whose data windows start at (3, -5) and (-7, 9). Left and
// right differ in brightness and in whether the albedo is constant: exposure and constant layers must be
// those of the whole frame.
class CliWindow : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    const Box2i low_window = window(3, -5, 64, 48);
    Image low = random_image(kColorNames, 64, 48, 5), high = random_image(kLayeredNames, 256, 192, 6);
    for (int c = 0; c < 3; ++c)
      for (int y = 0; y < low.height; ++y)
        for (int x = 0; x < low.width; ++x) low.at(c, y, x) = x < 28 ? 0.3f : 8 * low.at(c, y, x);
    for (int y = 0; y < high.height; ++y) {
      for (int c = 0; c < 3; ++c) {
        std::fill_n(&high.at(c, y, 0), 112, 0.3f);
        std::fill_n(&high.at(6 + c, y, 0), 200, 0.5f);
      }
    }
    write_image(folder_ / "low.exr", kColorNames, low, low_window, low_window);
    write_image(folder_ / "high.exr", kLayeredNames, high, data_, window(-10, 0, 300, 220));
    write_image(folder_ / "truth.exr", kColorNames, random_image(kColorNames, 256, 192, 7), data_, data_);
  }

  std::vector<std::string> fuse(const std::vector<std::string>& more,
                                const std::string& output = "out.exr") const {
    std::vector<std::string> arguments = {"fuse", "--lrhs",        "low.exr", "--hrls",        "high.exr",
                                          "-o",   output,          "--model", model_.string(), "--precision",
                                          "fp32", "--output-type", "float",   "--pair-check",  "off"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  Image part_of(const Image& whole, const Box2i& part) const {
    return crop(whole, part.min.x - data_.min.x, part.min.y - data_.min.y, width_of(part), height_of(part));
  }

  const Box2i data_ = window(-7, 9, 256, 192);
  // The parts lie in the middle, off the grid of 4 x 4 blocks, and at corners; then one pixel and everything.
  const std::vector<Box2i> parts_ = {window(116, 98, 13, 9),
                                     window(-7, 9, 20, 5),
                                     window(236, 191, 13, 10),
                                     window(-7, 196, 3, 5),
                                     window(200, 9, 49, 40),
                                     window(100, 120, 1, 1),
                                     data_};
  std::filesystem::path model_ = source_path("tests/golden/guided-x4.safetensors");
};

TEST_F(CliWindow, OfAPyramidHasTheBitsOfTheWholeFrame) {
  model_ = source_path("tests/golden/pyramid-x4.safetensors");
  const std::vector<std::string> direct{"--kernels", "direct"};
  ASSERT_EQ(run(fuse(direct, "whole.exr")).exit_status, 0);
  const Image whole = read("whole.exr");
  for (const Box2i& part : parts_) {
    ASSERT_EQ(run(fuse({"--kernels", "direct", "--window", text_of(part)})).exit_status, 0);
    EXPECT_EQ(read("out.exr").data, part_of(whole, part).data) << text_of(part);
  }
}

TEST_F(CliWindow, HasTheBitsOfTheWholeFrame) {
  const auto fuse_direct = [&](const std::vector<std::string>& more, const std::string& output) {
    std::vector<std::string> arguments = fuse(more, output);
    arguments.insert(arguments.end(), {"--kernels", "direct", "--keep-layers", "--json"});
    return run_json(arguments);
  };
  const Json whole_json = fuse_direct({}, "whole.exr");
  const Image whole = read("whole.exr"), layers = read("whole.exr", kLayeredNames);
  for (const Box2i& part : parts_) {
    SCOPED_TRACE(text_of(part));
    const Json json = fuse_direct({"--window", text_of(part)}, "out.exr");
    EXPECT_EQ(read("out.exr").data, part_of(whole, part).data);
    EXPECT_EQ(read("out.exr", kLayeredNames).data, part_of(layers, part).data);
    ExrFile fused(folder_ / "out.exr"), high(folder_ / "high.exr");
    EXPECT_EQ(fused.header().dataWindow(), part);
    EXPECT_EQ(fused.header().displayWindow(), high.header().displayWindow());
    EXPECT_EQ(fused.channel("A").type, Imf::HALF);
    for (const char* key : {"input_exposure", "constant_layers"})
      EXPECT_EQ(json.at(key), whole_json.at(key)) << key;
    const std::map<std::string, int> numbers{
        {"x", part.min.x}, {"y", part.min.y}, {"width", width_of(part)}, {"height", height_of(part)}};
    for (const auto& [key, value] : numbers) EXPECT_EQ(json.at(key), value) << key;
  }
}

TEST_F(CliWindow, IsTheWholeFramesWithinRoundingByAllKernels) {
  ASSERT_EQ(run(fuse({}, "whole.exr")).exit_status, 0);
  const Image whole = read("whole.exr");
  for (const Box2i& part : parts_) {
    ASSERT_EQ(run(fuse({"--window", text_of(part)})).exit_status, 0);
    const Image fused = read("out.exr"), expected = part_of(whole, part);
    for (size_t i = 0; i < fused.data.size(); ++i)
      ASSERT_NEAR(fused.data[i], expected.data[i], 1e-3 * (1 + expected.data[i])) << text_of(part);
  }
}

TEST_F(CliWindow, MeasuresAndShowsThePart) {
  const Box2i part = parts_[0];
  const Json json =
      run_json(fuse({"--window", text_of(part), "--reference", "truth.exr", "--json", "--preview",
                     "fused.png", "--preview-before-after", "all.png", "--dump", "layers"}));
  write_image(folder_ / "part.exr", kColorNames, part_of(read("truth.exr"), part), part, part);
  write_image(folder_ / "hrls.exr", kColorNames, part_of(read("high.exr"), part), part, part);
  for (const auto& [row, image] : {std::pair{"fused", "out.exr"}, {"hrls", "hrls.exr"}}) {
    const Json quality = run_json({"compare", image, "part.exr", "--json"});
    EXPECT_NEAR(json.at("metrics").at(row).at("psnr_db"), quality.at("psnr_db"), 1e-9) << row;
  }
  // The bicubic LRHS too is measured over the part alone.
  const Json whole = run_json(fuse({"--reference", "truth.exr", "--json", "--window", text_of(data_)}));
  EXPECT_NE(json.at("metrics").at("bicubic_lrhs"), whole.at("metrics").at("bicubic_lrhs"));
  for (const char* name : {"fused.png", "all.png", "layers"}) EXPECT_TRUE(files().contains(name)) << name;
}

TEST_F(CliWindow, CostsWhatItsPixelsCost) {
  const auto plan = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = fuse({"--dry-run", "--json"});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_json(arguments);
  };
  const Json whole = plan({});
  // The variance around a pixel, which companions compute within the part, takes one LRHS pixel more.
  const double halo = whole.at("halo").get<double>() + 1, gflop = whole.at("gflop");
  // The part touches columns 30 to 33 and rows 22 to 24 of LRHS, counted from the data window's corner.
  const Json part = plan({"--window", text_of(parts_[0])});
  EXPECT_EQ(part.at("tile_width"), 4 + 2 * halo);
  EXPECT_EQ(part.at("tile_height"), 3 + 2 * halo);
  EXPECT_NEAR(part.at("gflop"), gflop * (4 + 2 * halo) * (3 + 2 * halo) / (64 * 48), 1e-9);
  EXPECT_EQ(part.at("x"), 116);
  EXPECT_EQ(part.at("width"), 13);
  EXPECT_LT(part.at("peak_bytes"), whole.at("peak_bytes"));
  EXPECT_EQ(plan({"--window", text_of(data_)}), whole);
  const std::string text = run(fuse({"--dry-run", "--window", text_of(parts_[0])})).out;
  EXPECT_NE(text.find("window 13 x 9 at 116,98"), std::string::npos) << text;
}

TEST_F(CliWindow, TilesGiveTheSameBits) {
  const std::string part = text_of(window(20, 20, 120, 70));
  EXPECT_EQ(run_json(fuse({"--kernels", "direct", "--json", "--window", part})).at("tiles"), 1);
  const Image whole = read("out.exr");
  EXPECT_GT(
      run_json(fuse({"--kernels", "direct", "--json", "--max-memory", "1", "--window", part})).at("tiles"),
      1);
  EXPECT_EQ(read("out.exr").data, whole.data);
}

// Only the LRHS pixels that the data window of a border render touches cost work.
TEST_F(CliWindow, ADataWindowCostsWhatItsPixelsCost) {
  const Image border = random_image(kLayeredNames, 15, 14, 4);
  write_image(folder_ / "border.exr", kLayeredNames, border, window(5, 3, 15, 14), window(0, 0, 160, 96));
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 40, 24, 5));
  const auto gflop = [&](const std::string& lrhs, const std::string& hrls) {
    return run_json(
               {"fuse", "--lrhs", lrhs, "--hrls", hrls, "--model", model_.string(), "--dry-run", "--json"})
        .at("gflop")
        .get<double>();
  };
  write_image(folder_ / "cropped.exr", kColorNames, random_image(kColorNames, 4, 5, 1));
  write_image(folder_ / "full.exr", kLayeredNames, random_image(kLayeredNames, 16, 20, 2));
  const double expected = gflop("cropped.exr", "full.exr");
  EXPECT_GT(expected, 0);
  EXPECT_EQ(gflop("low.exr", "border.exr"), expected);
  // A window of the border render takes a halo that covers all of the data window.
  EXPECT_EQ(run_json({"fuse", "--lrhs", "low.exr", "--hrls", "border.exr", "--model", model_.string(),
                      "--dry-run", "--json", "--window", "6,4,2,2"})
                .at("gflop"),
            expected);
}

TEST_F(CliWindow, WhatIsNoPartIsAnError) {
  const auto error = [&](const std::string& part) {
    const ProcessResult result = run(fuse({"--window", part}));
    EXPECT_EQ(result.exit_status, 2) << part;
    EXPECT_FALSE(files().contains("out.exr"));
    return result.err;
  };
  for (const char* outside : {"-8,9,10,10", "300,0,5,5", "0,196,5,6", "-7,8,256,193"}) {
    const std::string text = error(outside);
    EXPECT_NE(text.find(fmt::format(
                  "--window {} is not within the data window -7,9,256,192 of HRLS 'high.exr'", outside)),
              std::string::npos)
        << text;
  }
  for (const char* bad : {"", "1,2,3", "1,2,3,4,5", "1,2,0,4", "1,2,3,-4", "1.5,2,3,4", "1,2,3,4 ", "1;2;3;4",
                          "2147483647,0,2,2", "99999999999,0,1,1"}) {
    const std::string text = error(bad);
    EXPECT_NE(text.find("--window"), std::string::npos) << text;
    EXPECT_NE(text.find("X,Y,WIDTH,HEIGHT"), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace raymeld::test
