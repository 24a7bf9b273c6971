// Tests `raymeld upscale`, which makes an image of LRHS alone.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfOutputFile.h>
#include <fmt/format.h>

#include <cmath>

#include "choice/curve.h"
#include "cli_fixture.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

// Writes a black image whose alpha are counts, not all the same.
void write_with_counts(const std::filesystem::path& path, int width, int height) {
  Imf::Header header(width, height);
  Imf::FrameBuffer frame;
  std::vector<half> color(size_t(width) * size_t(height));
  std::vector<unsigned> counts(color.size());
  counts[1] = 1;
  for (const char* name : {"R", "G", "B"}) {
    header.channels().insert(name, Imf::Channel(Imf::HALF));
    frame.insert(name, Imf::Slice(Imf::HALF, reinterpret_cast<char*>(color.data()), sizeof(half),
                                  sizeof(half) * size_t(width)));
  }
  header.channels().insert("A", Imf::Channel(Imf::UINT));
  frame.insert("A", Imf::Slice(Imf::UINT, reinterpret_cast<char*>(counts.data()), sizeof(unsigned),
                               sizeof(unsigned) * size_t(width)));
  Imf::OutputFile file(path.c_str(), header);
  file.setFrameBuffer(frame);
  file.writePixels(height);
}

// Has a render of 24 x 20 pixels, low.exr, with alpha, and upscales by 4.
class CliUpscale : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    write_image(folder_ / "low.exr", kAlphaNames, low_);
  }

  static std::vector<std::string> upscale(const std::vector<std::string>& more = {},
                                          const std::string& output = "out.exr") {
    return one_render({"upscale", "--lrhs", "low.exr"}, kModel, more, output);
  }
  static inline const std::string kModel = source_path("tests/golden/edsr-x4.safetensors").string();
  Image low_ = random_image(kAlphaNames, 24, 20, 3);
};

TEST_F(CliUpscale, SaysWhatItReadAndFound) {
  const ProcessResult result = run(upscale());
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_NE(result.err.find("read low.exr, 24 x 20: scale 4\n"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("upscaling on "), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("LRHS is an ordinary small render"), std::string::npos) << result.err;
  EXPECT_EQ(result.err.find("HRLS"), std::string::npos) << result.err;
  const Image out = read("out.exr");
  EXPECT_EQ(std::pair(out.width, out.height), std::pair(96, 80));
}

TEST_F(CliUpscale, ReportsNothingOfHrls) {
  write_image(folder_ / "truth.exr", kColorNames, random_image(kColorNames, 96, 80, 4));
  const Json json = run_json(
      upscale({"--json", "--reference", "truth.exr", "--preview-before-after", "both.png", "--profile"}));
  EXPECT_EQ(json.at("scale"), 4);
  EXPECT_EQ(json.at("lrhs_sampling"), "centered");
  EXPECT_EQ(json.at("metrics").size(), 2u);
  for (const auto& [key, value] : json.items()) EXPECT_EQ(key.find("hrls"), std::string::npos) << key;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "both.png"));
  const Json plan = run_json(upscale({"--json", "--dry-run"}));
  EXPECT_FALSE(plan.at("layers").contains("hrls"));
  for (const auto& [key, value] : plan.items()) EXPECT_EQ(key.find("hrls"), std::string::npos) << key;
  EXPECT_EQ(plan.at("runs"), 2);
  const ProcessResult text = run(upscale({"--dry-run"}));
  EXPECT_NE(text.out.find("1 tile(s) of 24 x 20 LRHS pixels, halo"), std::string::npos) << text.out;
}

TEST_F(CliUpscale, WindowsAreTheScaleTimesThoseOfLrhs) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 24, 20, 3), window(-3, 5, 24, 20),
              window(0, 0, 100, 60));
  ASSERT_EQ(run(upscale()).exit_status, 0);
  const ExrFile out(folder_ / "out.exr");
  EXPECT_EQ(out.header().dataWindow(), window(-12, 20, 96, 80));
  EXPECT_EQ(out.header().displayWindow(), window(0, 0, 400, 240));
}

TEST_F(CliUpscale, PartsAndTilesHaveTheBitsOfTheWholeFrame) {
  write_image(folder_ / "low.exr", kAlphaNames, random_image(kAlphaNames, 400, 24, 6));
  ASSERT_EQ(run(upscale({"--kernels", "direct"}, "whole.exr")).exit_status, 0);
  const Image whole = read("whole.exr");
  ASSERT_EQ(run(upscale({"--kernels", "direct", "--window", "327,5,21,11"})).exit_status, 0);
  EXPECT_EQ(read("out.exr").data, crop(whole, 327, 5, 21, 11).data);
  const Json json = run_json(upscale({"--kernels", "direct", "--max-memory", "4", "--json"}));
  EXPECT_GT(json.at("tiles"), 1);
  EXPECT_EQ(read("out.exr").data, whole.data);
}

// Channel attention is of all pixels, so that a part takes the whole frame.
TEST_F(CliUpscale, APartByChannelAttentionHasTheBitsOfTheWholeFrame) {
  const auto upscale = [](const std::vector<std::string>& more, const std::string& output) {
    return one_render({"upscale", "--lrhs", "low.exr"},
                      source_path("tests/golden/rcan-x2.safetensors").string(), more, output);
  };
  ASSERT_EQ(run(upscale({}, "whole.exr")).exit_status, 0);
  const Json part = run_json(upscale({"--json", "--window", "30,3,9,11"}, "out.exr"));
  EXPECT_EQ(read("out.exr").data, crop(read("whole.exr"), 30, 3, 9, 11).data);
  EXPECT_EQ(part.at("tiles"), 1);
}

TEST_F(CliUpscale, AlphaStaysWithinWhatIsAround) {
  low_ = random_image(kAlphaNames, 24, 20, 7);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 24; ++x) low_.at(3, y, x) = x < 12 ? 0.25f : 0.75f;
  write_image(folder_ / "low.exr", kAlphaNames, low_, Imf::FLOAT);
  ASSERT_EQ(run(upscale()).exit_status, 0);
  const Image alpha = read("out.exr", {"A"});
  int between = 0;
  for (int y = 0; y < 80; ++y) {
    for (int x = 0; x < 96; ++x) {
      const float value = alpha.at(0, y, x);
      // The 3x3 pixels around have one alpha but at the two middle columns of LRHS.
      ASSERT_GE(value, x / 4 > 12 ? 0.75f : 0.25f) << x;
      ASSERT_LE(value, x / 4 < 11 ? 0.25f : 0.75f) << x;
      between += value != 0.25f && value != 0.75f;
    }
  }
  EXPECT_GT(between, 0);
}

TEST_F(CliUpscale, AnEvenAlphaStaysEven) {
  std::fill_n(low_.plane(3), low_.plane_size(), 0.5f);
  write_image(folder_ / "low.exr", kAlphaNames, low_);
  ASSERT_EQ(run(upscale({"--window", "4,8,20,12"})).exit_status, 0);
  const Image alpha = read("out.exr", {"A"});
  EXPECT_EQ(alpha.data, std::vector<float>(20 * 12, 0.5f));
}

TEST_F(CliUpscale, AlphasThatCannotBeUpscaledAreErrorsAndOthersAreMended) {
  write_with_counts(folder_ / "low.exr", 24, 20);
  for (const char* run : {"--quiet", "--dry-run"})
    expect_error(upscale({run}), {"alpha 'A' must have floats"});
  std::fill_n(low_.plane(3), low_.plane_size(), NAN);
  write_image(folder_ / "low.exr", kAlphaNames, low_);
  const Json json = run_json(upscale({"--json"}));
  ASSERT_EQ(json.at("warnings").size(), 1u) << json.at("warnings");
  EXPECT_EQ(json.at("warnings").at(0).at("count"), 24 * 20);
  EXPECT_NE(json.at("warnings").at(0).at("message").get<std::string>().find("LRHS 'low.exr'"),
            std::string::npos);
  EXPECT_EQ(read("out.exr", {"A"}).data, std::vector<float>(96 * 80, 0.0f));
}

TEST_F(CliUpscale, KindsOfLightAddUpToTheColor) {
  const std::vector<std::string> names = with_split_light(kColorNames);
  write_image(folder_ / "low.exr", names, random_image(names, 24, 20, 5));
  ASSERT_EQ(run(upscale({"--layers"})).exit_status, 0);
  expect_light_adds_up();
  const Image diffuse = read("out.exr", {"diffuse.R", "diffuse.G", "diffuse.B"});
  EXPECT_NE(diffuse.data, read("out.exr", {"specular.R", "specular.G", "specular.B"}).data);
  EXPECT_NE(diffuse.data, read("out.exr").data);
}

// The model's own command and scale choose it.
TEST_F(CliUpscale, TheStockModelOfTheScaleIsTheDefault) {
  std::filesystem::create_directory(folder_ / "models");
  std::filesystem::copy_file(kModel, folder_ / "models/x4-up.safetensors");
  std::filesystem::copy_file(tiny_model(), folder_ / "models/x4-tiny.safetensors");
  save_curve(folder_ / "models/curve.json",
             {"", "", {{"x4-tiny", 4, 1, 40}, {"x4-up", 4, 1, 30, Task::kUpscale}}});
  environment_["RAYMELD_MODELS"] = (folder_ / "models").string();
  for (const std::vector<std::string>& chosen :
       {std::vector<std::string>{"--scale", "4"}, {"--model", "x4"}, {"--scale", "4", "--quality", "high"}}) {
    std::vector<std::string> arguments = {"upscale", "--lrhs", "low.exr", "-o", "out.exr", "--json"};
    arguments.insert(arguments.end(), chosen.begin(), chosen.end());
    EXPECT_EQ(run_json(arguments).at("model"), "edsr-x4");
  }
  std::filesystem::remove(folder_ / "out.exr");
  expect_error({"upscale", "--lrhs", "low.exr", "-o", "out.exr"}, {"no stock model that upscales by 2"});
}

TEST_F(CliUpscale, UpscalesSequences) {
  write_image(folder_ / "in.1.exr", kAlphaNames, low_);
  for (const char* frame : {"in.2.exr", "in.3.exr"})
    write_image(folder_ / frame, kAlphaNames, random_image(kAlphaNames, 24, 20, 8));
  std::vector<std::string> arguments =
      upscale({"--frames", "1-3", "--skip-unchanged", "--input-exposure", "off"}, "out.#.exr");
  arguments[2] = "in.#.exr";
  ASSERT_EQ(run(upscale({"--input-exposure", "off"})).exit_status, 0);
  const ProcessResult result = run(arguments);
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_NE(result.err.find("3 frames: 3 upscaled; "), std::string::npos) << result.err;
  EXPECT_EQ(read("out.1.exr").data, read("out.exr").data);
  EXPECT_NE(read("out.2.exr").data, read("out.exr").data);
  EXPECT_EQ(read("out.3.exr").data, read("out.2.exr").data);
  arguments.push_back("--json");
  const Json frames = run_json(arguments).at("frames");
  EXPECT_EQ(frames.at(1).at("skipped_share"), 0);
  EXPECT_EQ(frames.at(2).at("skipped_share"), 1);
  arguments[2] = "low.exr";
  EXPECT_NE(run(arguments).err.find("--frames: --lrhs 'low.exr' has no # for the frame's number"),
            std::string::npos);
}

TEST_F(CliUpscale, CommandsModelsAndSizesThatDoNotFitAreNamed) {
  expect_error({"fuse", "--lrhs", "low.exr", "-o", "out.exr"},
               {"--hrls is required; raymeld upscale takes --lrhs alone"});
  expect_error({"fuse", "--lrhs", "low.exr", "--hrls", "low.exr", "-o", "out.exr", "--model", kModel},
               {"raymeld upscale takes it, with --lrhs alone"});
  expect_error({"upscale", "--lrhs", "low.exr", "-o", "out.exr", "--model", tiny_model()},
               {"raymeld fuse takes it, with --lrhs and --hrls"});
  expect_error({"upscale", "-o", "out.exr"}, {"--lrhs is required"});
  expect_error({"upscale", "--hrls", "low.exr", "-o", "out.exr"}, {"--hrls"});
  write_image(folder_ / "far.exr", kColorNames, low_, window((1 << 29) + 1, 0, 24, 20), window(0, 0, 24, 20));
  expect_error({"upscale", "--lrhs", "far.exr", "-o", "out.exr", "--model", kModel},
               {"LRHS 'far.exr' has a window from 536870913,0"});
  expect_error(upscale({"--scale", "2"}), {"has a scale of 4, and --scale is 2"});
  expect_error(upscale({"--window", "90,70,10,10"}),
               {"data window 0,0,96,80 of the upscaled LRHS 'low.exr'"});
  write_image(folder_ / "truth.exr", kColorNames, random_image(kColorNames, 24, 20, 4));
  expect_error(upscale({"--reference", "truth.exr"}), {"the upscaled LRHS 'low.exr' is 96 x 80"});
}

}  // namespace
}  // namespace raymeld::test
