// Tests the lines that fuse writes to stderr.
#include <fmt/format.h>

#include <sstream>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

class CliReport : public Cli {
 protected:
  std::vector<std::string> lines(const std::vector<std::string>& arguments) const {
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 0) << result.err;
    std::istringstream stream(result.err);
    std::vector<std::string> lines;
    for (std::string line; std::getline(stream, line);) {
      const bool is_progress = line.ends_with(" %");  // is written every few seconds
      if (!is_progress && !line.starts_with("compiling kernels")) lines.push_back(line);
    }
    return lines;
  }
};

TEST_F(CliReport, AFusedFrameIsFiveLines) {
  const std::vector<std::string> said = lines(fuse({"--preview", "fused.png"}));
  const std::string device =
      run_json({"devices", "--json"}).at("devices").at(0).at("name").get<std::string>();
  ASSERT_EQ(said.size(), 5u) << fmt::format("{}", fmt::join(said, "\n"));
  EXPECT_EQ(said[0], "read low.exr, 8 x 6, and high.exr, 32 x 24: scale 4");
  EXPECT_EQ(said[1].find(fmt::format("fusing on {} with tiny-x4 in fp", device)), 0u) << said[1];
  EXPECT_EQ(said[2],
            "found: LRHS is an ordinary small render, as the pixels do not show another kind; "
            "tiny-x4 was not trained on centered LRHS");
  EXPECT_EQ(said[3].find("took "), 0u) << said[3];
  for (const char* part :
       {" ms on the device, ", " ms in total, ", " MiB of device memory; input exposure 1"})
    EXPECT_NE(said[3].find(part), std::string::npos) << said[3];
  EXPECT_EQ(said[4], "wrote out.exr, fused.png");
}

TEST_F(CliReport, VerboseShowsTheChannelsToo) {
  const std::vector<std::string> said = lines(fuse({"--verbose"}));
  EXPECT_GT(said.size(), 5u);
  EXPECT_EQ(said[0], "LRHS low.exr: color from R, G, B");
  EXPECT_EQ(std::ranges::count(said, "  normal   normal.X, normal.Y, normal.Z"), 1);
  const ProcessResult both = run(fuse({"--verbose", "--quiet"}));
  EXPECT_EQ(both.exit_status, 2);
  EXPECT_NE(both.err.find("--quiet"), std::string::npos) << both.err;
}

TEST_F(CliReport, TheWindowIsSaid) {
  EXPECT_EQ(lines(fuse({"--window", "4,8,12,16"})).at(0),
            "read low.exr, 8 x 6, and high.exr, 32 x 24, window 12 x 16 at 4,8: scale 4");
}

// The model takes an albedo and can do without it; here it is first constant and then missing.
TEST_F(CliReport, ConstantAndMissingLayersAreFound) {
  std::vector<std::string> arguments = fuse();
  arguments.back() = source_path("tests/golden/guided-x4.safetensors").string();
  Image high = read("high.exr", kLayeredNames);
  for (int c = 6; c < 9; ++c) std::fill_n(high.plane(c), high.plane_size(), 0.5f);
  write_image(folder_ / "high.exr", kLayeredNames, high);
  const std::string constant = lines(arguments).at(2);
  EXPECT_NE(constant.find("; albedo is 0.5, 0.5, 0.5 everywhere"), std::string::npos) << constant;
  EXPECT_EQ(constant.find("no albedo"), std::string::npos) << constant;
  const std::vector<std::string> names(kLayeredNames.begin(), kLayeredNames.begin() + 6);
  write_image(folder_ / "high.exr", names, high);
  const std::string missing = lines(arguments).at(2);
  EXPECT_NE(missing.find("; no albedo, which costs about 0.8 dB"), std::string::npos) << missing;
  EXPECT_EQ(missing.find("everywhere"), std::string::npos) << missing;
}

TEST_F(CliReport, TheViewLayerThatIsReadIsSaid) {
  std::vector<std::string> names;
  for (const char* layer : {"Left", "Right"})
    for (const char* pass : {"Combined", "Denoising Normal", "Denoising Albedo"})
      for (const std::string& color : kColorNames)
        names.push_back(fmt::format("{}.{}.{}", layer, pass, color));
  write_image(folder_ / "high.exr", names, random_image(names, 32, 24, 2));
  const std::string both = lines(fuse()).at(2);
  EXPECT_NE(both.find("HRLS has several view layers, and 'Left' is read; others are --map viewlayer=Right"),
            std::string::npos)
      << both;
  EXPECT_EQ(lines(fuse({"--map", "viewlayer=Right"})).at(2).find("several"), std::string::npos);
}

}  // namespace
}  // namespace raymeld::test
