// Tests `raymeld denoise`, which makes an image of HRLS alone.
#include <fmt/format.h>

#include <cmath>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

// Has a render of 96 x 80 pixels, high.exr, with layers and alpha.
class CliDenoise : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    write_image(folder_ / "high.exr", kLayeredNames, high_);
  }

  static std::vector<std::string> denoise(const std::vector<std::string>& more = {},
                                          const std::string& output = "out.exr") {
    return one_render({"denoise", "--hrls", "high.exr"}, kModel, more, output);
  }
  std::vector<std::string> lines(const std::vector<std::string>& arguments) const {
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 0) << result.err;
    std::vector<std::string> lines;
    std::istringstream stream(result.err);
    for (std::string line; std::getline(stream, line);) lines.push_back(line);
    return lines;
  }

  static inline const std::string kModel = source_path("tests/golden/pyramid-x1.safetensors").string();
  Image high_ = random_image(kLayeredNames, 96, 80, 3);
};

TEST_F(CliDenoise, SaysWhatItReadAndFound) {
  const std::vector<std::string> said = lines(denoise({"--hrls-spp", "4"}));
  const auto has = [&](const std::string& text) { return std::ranges::find(said, text) != said.end(); };
  EXPECT_TRUE(has("read high.exr, 96 x 80")) << fmt::format("{}", fmt::join(said, "\n"));
  const auto found = std::ranges::find_if(said, [](const auto& line) { return line.starts_with("found: "); });
  ASSERT_NE(found, said.end());
  EXPECT_TRUE(found->starts_with("found: 4 samples a pixel; input exposure ")) << *found;
  for (const std::string& line : said) EXPECT_EQ(line.find("LRHS"), std::string::npos) << line;
  EXPECT_EQ(read("out.exr").width, 96);
}

TEST_F(CliDenoise, ReportsNothingOfLrhs) {
  write_image(folder_ / "truth.exr", kColorNames, random_image(kColorNames, 96, 80, 4));
  const Json json = run_json(denoise({"--json", "--reference", "truth.exr"}));
  EXPECT_EQ(json.at("scale"), 1);
  EXPECT_EQ(json.at("metrics").size(), 2u);
  for (const auto& [key, value] : json.items()) EXPECT_EQ(key.find("lrhs"), std::string::npos) << key;
  const Json plan = run_json(denoise({"--json", "--dry-run"}));
  EXPECT_FALSE(plan.at("layers").contains("lrhs"));
  const ProcessResult text = run(denoise({"--dry-run"}));
  EXPECT_NE(text.out.find("1 tile(s) of 96 x 80 pixels, halo"), std::string::npos) << text.out;
  EXPECT_EQ(text.out.find("LRHS"), std::string::npos) << text.out;
}

// The network reaches less far than to the ends of the frame.
TEST_F(CliDenoise, APartHasTheBitsOfTheWholeFrame) {
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 700, 24, 6));
  ASSERT_EQ(run(denoise({"--kernels", "direct"}, "whole.exr")).exit_status, 0);
  const Image whole = read("whole.exr");
  ASSERT_EQ(run(denoise({"--kernels", "direct", "--window", "327,5,21,11"})).exit_status, 0);
  EXPECT_EQ(read("out.exr").data, crop(whole, 327, 5, 21, 11).data);
  EXPECT_LT(run_json(denoise({"--json", "--dry-run", "--window", "327,5,21,11"})).at("gflop"),
            run_json(denoise({"--json", "--dry-run"})).at("gflop"));
}

TEST_F(CliDenoise, TilesHaveTheBitsOfTheWholeFrame) {
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 2000, 24, 7));
  ASSERT_EQ(run(denoise({"--kernels", "direct"}, "whole.exr")).exit_status, 0);
  const Json json = run_json(denoise({"--kernels", "direct", "--max-memory", "6", "--json"}));
  EXPECT_GT(json.at("tiles"), 1);
  EXPECT_EQ(read("out.exr").data, read("whole.exr").data);
}

TEST_F(CliDenoise, GuidesAndPicturesAreThoseOfHrls) {
  Image guides = high_;
  for (int c = 3; c < 9; ++c) std::fill_n(guides.plane(c), guides.plane_size(), 0.5f);
  write_image(folder_ / "guides.exr", kLayeredNames, guides);
  ASSERT_EQ(run(denoise({}, "without.exr")).exit_status, 0);
  ASSERT_EQ(run(denoise({"--guides", "guides.exr", "--preview", "out.png", "--preview-before-after",
                         "both.png", "--keep-layers"}))
                .exit_status,
            0);
  EXPECT_NE(read("out.exr").data, read("without.exr").data);
  EXPECT_EQ(read("out.exr", {"normal.X"}).data, read("high.exr", {"normal.X"}).data);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "both.png"));
}

TEST_F(CliDenoise, AlphaAndTheKindsOfLightAreDenoisedToo) {
  const std::vector<std::string> names = with_split_light(kLayeredNames);
  write_image(folder_ / "high.exr", names, random_image(names, 96, 80, 5));
  ASSERT_EQ(run(denoise({"--layers"})).exit_status, 0);
  EXPECT_NE(read("out.exr", {"A"}).data, read("high.exr", {"A"}).data);
  expect_light_adds_up();
}

TEST_F(CliDenoise, ValuesThatAreNotFiniteAreCountedOnce) {
  high_.at(0, 3, 4) = NAN;
  write_image(folder_ / "high.exr", kLayeredNames, high_);
  const Json json = run_json(denoise({"--json"}));
  ASSERT_EQ(json.at("warnings").size(), 1u) << json.at("warnings");
  EXPECT_EQ(json.at("warnings").at(0).at("count"), 1);
}

TEST_F(CliDenoise, DenoisesSequences) {
  write_image(folder_ / "in.1.exr", kLayeredNames, high_);
  write_image(folder_ / "in.2.exr", kLayeredNames, random_image(kLayeredNames, 96, 80, 8));
  ASSERT_EQ(run(denoise()).exit_status, 0);
  std::vector<std::string> arguments = denoise({"--frames", "1-2"}, "out.#.exr");
  arguments[2] = "in.#.exr";
  ASSERT_EQ(run(arguments).exit_status, 0);
  EXPECT_EQ(read("out.1.exr").data, read("out.exr").data);
  EXPECT_NE(read("out.2.exr").data, read("out.exr").data);
  arguments[2] = "high.exr";
  EXPECT_NE(run(arguments).err.find("--frames: --hrls 'high.exr' has no # for the frame's number"),
            std::string::npos);
}

TEST_F(CliDenoise, CommandsAndModelsThatDoNotFitAreNamed) {
  const auto refused = [&](std::vector<std::string> arguments, const std::string& message) {
    const ProcessResult result = run(std::move(arguments));
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_NE(result.err.find(message), std::string::npos) << result.err;
  };
  refused({"fuse", "--hrls", "high.exr", "-o", "out.exr"},
          "--lrhs is required; raymeld denoise takes --hrls alone");
  refused({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "out.exr", "--model", kModel},
          "raymeld denoise takes it, with --hrls alone");
  refused({"denoise", "--hrls", "high.exr", "-o", "out.exr", "--model", tiny_model()},
          "raymeld fuse takes it, with --lrhs and --hrls");
  refused({"denoise", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "out.exr"}, "--lrhs");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.exr"));
  EXPECT_NE(run({"fuse", "--help"}).out.find("OpenEXR file (required)"), std::string::npos);
}

}  // namespace
}  // namespace raymeld::test
