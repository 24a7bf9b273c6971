// Tests what is fused beside the color: alpha, and with --layers the parts of the light.
#include <map>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

const std::vector<std::string> kLitNames = {
    "R",        "G",         "B",         "normal.X",  "normal.Y",   "normal.Z",   "albedo.R",  "albedo.G",
    "albedo.B", "diffuse.R", "diffuse.G", "diffuse.B", "specular.R", "specular.G", "specular.B"};
constexpr float kTolerance = 1e-6f;

class CliCompanions : public Cli {
 protected:
  void fuse_to(const std::string& output, const std::string& lrhs, const std::string& hrls,
               const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {
        "fuse",   "--lrhs",        lrhs,      "--hrls",          hrls,
        "-o",     output,          "--model", tiny_model(),      "--kernels",
        "direct", "--output-type", "float",   "--quiet",         "--precision",
        "fp32",   "--pair-check",  "off",     "--lrhs-sampling", "centered"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessResult result = run(arguments);
    ASSERT_EQ(result.exit_status, 0) << result.err;
  }
};

// Fills the part left of column `edge` with 1 and the rest with 0. The column has `even` and `odd` in turn.
void draw_edge(Image& image, int channel, int edge, float even, float odd) {
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      image.at(channel, y, x) = x == edge ? (y % 2 == 0 ? even : odd) : float(x < edge);
}

TEST_F(CliCompanions, AlphaIsFusedAsTheImageOfAWhiteSurface) {
  Image low = random_image(kAlphaNames, 8, 6, 1), high = random_image(kLayeredNames, 32, 24, 2);
  draw_edge(low, 3, 3, 0.5f, 0.5f);
  draw_edge(high, 9, 13, 1, 0);
  write_image(folder_ / "low.exr", kAlphaNames, low, Imf::FLOAT);
  write_image(folder_ / "high.exr", kLayeredNames, high, Imf::FLOAT);
  fuse_to("out.exr", "low.exr", "high.exr");
  Image white_low(8, 6, 3), white = high;
  for (int c = 0; c < 3; ++c) {
    std::copy_n(low.plane(3), low.plane_size(), white_low.plane(c));
    for (int first : {0, 6}) std::copy_n(high.plane(9), high.plane_size(), white.plane(first + c));
  }
  write_image(folder_ / "white-low.exr", kColorNames, white_low, Imf::FLOAT);
  write_image(folder_ / "white.exr", kLayeredNames, white, Imf::FLOAT);
  fuse_to("white-out.exr", "white-low.exr", "white.exr", {"--input-exposure", "1"});
  const Image alpha = read("out.exr", {"A"}), fused = read("white-out.exr");
  int changed = 0;
  for (int y = 0; y < 24; ++y) {
    for (int x = 0; x < 32; ++x) {
      // Elsewhere the 3x3 pixels of HRLS and the cell of LRHS have one value.
      const bool is_edge = x >= 12 && x <= 15;
      const float mean = (fused.at(0, y, x) + fused.at(1, y, x) + fused.at(2, y, x)) / 3;
      const float expected = is_edge ? std::clamp(mean, 0.0f, x == 15 ? 0.5f : 1.0f) : high.at(9, y, x);
      EXPECT_NEAR(alpha.at(0, y, x), expected, kTolerance) << y << " " << x;
      changed += alpha.at(0, y, x) != high.at(9, y, x);
    }
  }
  EXPECT_GT(changed, 24);
}

TEST_F(CliCompanions, AlphaIsCopiedWhereItIsTheSameEverywhereOrLrhsHasNone) {
  Image high = random_image(kLayeredNames, 32, 24, 2);
  write_image(folder_ / "high.exr", kLayeredNames, high);
  fuse_to("out.exr", "low.exr", "high.exr");  // low.exr has no alpha
  EXPECT_EQ(ExrFile(folder_ / "out.exr").read_raw("A").bytes,
            ExrFile(folder_ / "high.exr").read_raw("A").bytes);
  Image low = random_image(kAlphaNames, 8, 6, 1);
  std::fill_n(low.plane(3), low.plane_size(), 0.5f);
  std::fill_n(high.plane(9), high.plane_size(), 0.5f);
  write_image(folder_ / "low.exr", kAlphaNames, low);
  write_image(folder_ / "high.exr", kLayeredNames, high);
  fuse_to("out.exr", "low.exr", "high.exr");
  EXPECT_EQ(ExrFile(folder_ / "out.exr").read_raw("A").bytes,
            ExrFile(folder_ / "high.exr").read_raw("A").bytes);
  EXPECT_EQ(ExrFile(folder_ / "out.exr").channel("A").type, Imf::HALF);
}

// LRHS's own alpha is another one where an option names HRLS's.
TEST_F(CliCompanions, AnAlphaThatAnOptionNamesIsCopied) {
  const std::vector<std::string> names = {
      "R", "G", "B", "A", "normal.X", "normal.Y", "normal.Z", "albedo.R", "albedo.G", "albedo.B", "mask"};
  write_image(folder_ / "low.exr", kAlphaNames, random_image(kAlphaNames, 8, 6, 1));
  write_image(folder_ / "high.exr", names, random_image(names, 32, 24, 2));
  fuse_to("out.exr", "low.exr", "high.exr", {"--map", "alpha=mask"});
  EXPECT_EQ(read("out.exr", {"A"}).data, read("high.exr", {"mask"}).data);
}

TEST_F(CliCompanions, PartsOfTheLightAddUpToTheColor) {
  Image low = random_image(kLitNames, 8, 6, 3), high = random_image(kLitNames, 32, 24, 4);
  for (Image* image : {&low, &high}) {
    for (float& value : image->data) value *= 0.5f;
    for (int c = 0; c < 3; ++c)  // color is more than diffuse and specular, but for the upper rows
      for (int y = 2; y < image->height; ++y)
        for (int x = 0; x < image->width; ++x)
          image->at(c, y, x) += image->at(9 + c, y, x) + image->at(12 + c, y, x);
  }
  write_image(folder_ / "low.exr", kLitNames, low, Imf::FLOAT);
  write_image(folder_ / "high.exr", kLitNames, high, Imf::FLOAT);
  fuse_to("out.exr", "low.exr", "high.exr", {"--layers", "--input-exposure", "1"});
  const Image color = read("out.exr");
  // Each part is fused by a run of its own, as the color of a pair that has no other light.
  std::vector<Image> parts, shares;
  for (const std::string part : {"diffuse", "specular", "emission"}) {
    for (auto [name, image] : {std::pair("part-low.exr", low), std::pair("part-high.exr", high)}) {
      const Image before = image;
      for (size_t i = 0; i < 3 * image.plane_size(); ++i) {
        const float diffuse = before.plane(9)[i], specular = before.plane(12)[i];
        image.data[i] = part == "diffuse"    ? diffuse
                        : part == "specular" ? specular
                                             : std::max(before.data[i] - diffuse - specular, 0.0f);
      }
      write_image(folder_ / name, kLitNames, image, Imf::FLOAT);
    }
    fuse_to("part.exr", "part-low.exr", "part-high.exr", {"--input-exposure", "1"});
    parts.push_back(read("part.exr"));
    shares.push_back(read("out.exr", {part + ".R", part + ".G", part + ".B"}));
  }
  size_t shared = 0;
  for (size_t i = 0; i < color.data.size(); ++i) {
    const float sum = parts[0].data[i] + parts[1].data[i] + parts[2].data[i];
    const float tolerance = 1e-6f * (1 + color.data[i]);
    for (size_t p = 0; p < 3; ++p) {
      const float share = sum > 0 ? parts[p].data[i] / sum : float(p == 2);
      EXPECT_NEAR(shares[p].data[i], share * color.data[i], tolerance) << p << " " << i;
    }
    shared += sum > 0;
    EXPECT_NEAR(shares[0].data[i] + shares[1].data[i] + shares[2].data[i], color.data[i], tolerance);
  }
  EXPECT_GT(shared, color.data.size() / 2);
  fuse_to("kept.exr", "low.exr", "high.exr", {"--layers", "--input-exposure", "1", "--keep-layers"});
  EXPECT_EQ(read("kept.exr", {"diffuse.R"}).data, read("out.exr", {"diffuse.R"}).data);
  EXPECT_EQ(read("kept.exr", {"albedo.R"}).data, read("high.exr", {"albedo.R"}).data);
}

// Values that are not finite are warned of once, and each run of the network counts in the plan.
TEST_F(CliCompanions, WarningsAndRunsAreCountedOnce) {
  Image low = random_image(kLitNames, 8, 6, 3), high = random_image(kLitNames, 32, 24, 4);
  for (const int channel : {0, 9, 12}) low.at(channel, 1, 1) = high.at(channel, 2, 2) = NAN;
  write_image(folder_ / "low.exr", kLitNames, low);
  write_image(folder_ / "high.exr", kLitNames, high);
  const auto warnings = [&](const std::vector<std::string>& more) {
    const Json json = run_json(fuse(more));
    std::map<std::string, int> counts;
    for (const Json& warning : json.at("warnings")) {
      const std::string text = warning.at("message");
      if (text.find("are NaN") != std::string::npos)
        counts[text.substr(0, 4)] += warning.at("count").get<int>();
    }
    return counts;
  };
  const std::map<std::string, int> expected{{"LRHS", 3}, {"HRLS", 3}};
  EXPECT_EQ(warnings({"--layers", "--json"}), expected);
  const Json plan = run_json(fuse({"--dry-run", "--json"})),
             all = run_json(fuse({"--layers", "--dry-run", "--json"}));
  EXPECT_EQ(plan.at("runs"), 1);
  EXPECT_EQ(all.at("runs"), 4);
  EXPECT_DOUBLE_EQ(all.at("gflop"), 4 * plan.at("gflop").get<double>());
}

TEST_F(CliCompanions, PartsOfTheLightNeedTheLayers) {
  expect_error(fuse({"--layers"}), {"low.exr", "diffuse", "specular"});
  write_image(folder_ / "low.exr", kLitNames, random_image(kLitNames, 8, 6, 3));
  expect_error(fuse({"--layers"}), {"high.exr", "diffuse", "specular"});
}

}  // namespace
}  // namespace raymeld::test
