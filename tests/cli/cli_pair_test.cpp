// Tests which properties of a pair fuse finds out, and how it handles each.
#include <OpenEXR/ImfStringAttribute.h>
#include <fmt/format.h>

#include <map>

#include "choice/metrics.h"
#include "cli_fixture.h"
#include "made_pair.h"

namespace raymeld::test {
namespace {

class CliPair : public Cli {
 protected:
  void write_pair(const Image& lrhs, const Image& color) {
    Image hrls(color.width, color.height, int(kLayeredNames.size()));
    for (int c = 0; c < hrls.channels; ++c)
      std::copy_n(color.plane(c % 3), color.plane_size(), hrls.plane(c));
    write_image(folder_ / "low.exr", kColorNames, lrhs, Imf::FLOAT);
    write_image(folder_ / "high.exr", kLayeredNames, hrls, Imf::FLOAT);
  }
  void write_pair(const Pair& pair) { write_pair(pair.lrhs, pair.hrls); }

  Image fused(const std::vector<std::string>& more = {}) {
    const ProcessResult result = run(fuse(more));
    EXPECT_EQ(result.exit_status, 0) << result.err;
    return read("out.exr");
  }
  std::string said(const std::vector<std::string>& more = {}) {
    const ProcessResult result = run(fuse(more));
    EXPECT_EQ(result.exit_status, 0) << result.err;
    return result.err;
  }
  nlohmann::json planned(const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = fuse({"--dry-run", "--json"});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_json(arguments);
  }
};

TEST_F(CliPair, WhereSamplesLieIsFoundFromThePixels) {
  for (const std::string sampling : {"nearest", "centered"}) {
    write_pair(make_pair(4, sampling == "centered"));
    const nlohmann::json plan = planned();
    EXPECT_EQ(plan.at("lrhs_sampling"), sampling);
    EXPECT_EQ(plan.at("lrhs_sampling_from"), "pair");
    EXPECT_EQ(fused().data, fused({"--lrhs-sampling", sampling}).data);
  }
  EXPECT_NE(said().find("found: LRHS is an ordinary small render, as the pixels show"), std::string::npos);
}

TEST_F(CliPair, TheOptionAndTheFileDecideOverThePixels) {
  const Pair pair = make_pair(4, true);
  write_pair(pair);
  const nlohmann::json asked = planned({"--lrhs-sampling", "nearest"});
  EXPECT_EQ(asked.at("lrhs_sampling"), "nearest");
  EXPECT_EQ(asked.at("lrhs_sampling_from"), "option");
  ExrOutput marked;
  marked.source = Imf::Header(pair.lrhs.width, pair.lrhs.height);
  marked.source.insert("raymeldSampling", Imf::StringAttribute("nearest"));
  for (int c = 0; c < 3; ++c)
    marked.planes.push_back({kColorNames[size_t(c)], Imf::FLOAT, pair.lrhs.plane(c)});
  write_exr(folder_ / "low.exr", marked);
  EXPECT_EQ(planned().at("lrhs_sampling_from"), "file");
  EXPECT_EQ(planned().at("lrhs_sampling"), "nearest");
}

// A model that knows samples takes them from an option, else from the file, else for the usual ones.
TEST_F(CliPair, SamplesAreWhatTheOptionOrTheFileSays) {
  const Pair pair = make_pair(4, true);
  write_pair(pair);
  std::map<std::string, std::vector<float>> seen;
  const auto fuse_with = [&](const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{
        "fuse",      "--lrhs",   "low.exr",
        "--hrls",    "high.exr", "-o",
        "fused.exr", "--model",  source_path("tests/golden/spp-x4.safetensors").string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 0) << result.err;
    seen[name] = read("fused.exr").data;
    return result.err;
  };
  EXPECT_NE(fuse_with("unknown", {}).find("16 and 1 samples a pixel, as the files do not say"),
            std::string::npos);
  EXPECT_NE(fuse_with("said", {"--lrhs-spp", "64", "--hrls-spp", "2"}).find("64 and 2 samples a pixel"),
            std::string::npos);
  fuse_with("usual", {"--lrhs-spp", "16", "--hrls-spp", "1"});
  ExrOutput marked;
  marked.source = Imf::Header(pair.lrhs.width, pair.lrhs.height);
  marked.source.insert("cycles.ViewLayer.samples", Imf::StringAttribute("64"));
  const std::vector<std::string> names{"ViewLayer.Combined.R", "ViewLayer.Combined.G",
                                       "ViewLayer.Combined.B"};
  for (int c = 0; c < 3; ++c) marked.planes.push_back({names[size_t(c)], Imf::FLOAT, pair.lrhs.plane(c)});
  write_exr(folder_ / "low.exr", marked);
  EXPECT_NE(fuse_with("file", {"--hrls-spp", "2"}).find("64 and 2 samples a pixel"), std::string::npos);
  EXPECT_EQ(seen["usual"], seen["unknown"]);
  EXPECT_EQ(seen["file"], seen["said"]);
  EXPECT_NE(seen["said"], seen["usual"]);
  const ProcessResult refused = run({"fuse", "--lrhs-spp", "-1"});
  EXPECT_NE(refused.exit_status, 0);
  EXPECT_NE(refused.err.find("--lrhs-spp"), std::string::npos) << refused.err;
}

// The samples of an LRHS of x8 are interpolated at the middles of 4x4 pixels, and each counts for four of
// these.
TEST_F(CliPair, AnX4ModelFusesAnLrhsOfX8) {
  const Image low = random_image(kColorNames, 7, 5, 1), high = random_image(kLayeredNames, 56, 40, 2);
  write_image(folder_ / "low.exr", kColorNames, low, Imf::FLOAT);
  write_image(folder_ / "high.exr", kLayeredNames, high, Imf::FLOAT);
  const Image reference = first_channels(high, 3);
  write_image(folder_ / "reference.exr", kColorNames, reference, Imf::FLOAT);
  const auto fuse_to = [&](const std::string& output, const std::string& lrhs, const std::string& sampling,
                           const std::string& spp, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{"fuse",
                                       "--lrhs",
                                       lrhs,
                                       "--hrls",
                                       "high.exr",
                                       "-o",
                                       output,
                                       "--model",
                                       source_path("tests/golden/spp-x4.safetensors").string(),
                                       "--lrhs-spp",
                                       spp,
                                       "--hrls-spp",
                                       "2",
                                       "--output-type",
                                       "float",
                                       "--precision",
                                       "fp32",
                                       "--kernels",
                                       "direct",
                                       "--pair-check",
                                       "off",
                                       "--input-exposure",
                                       "1",
                                       "--lrhs-sampling",
                                       sampling,
                                       "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_json(arguments);
  };
  for (const auto& [sampling, phase] : {std::pair("centered", 3.5), {"nearest", 0.0}}) {
    Image twice(14, 10, 3);
    for (int c = 0; c < 3; ++c) {
      for (int y = 0; y < twice.height; ++y) {
        for (int x = 0; x < twice.width; ++x) {
          const double v = (4 * y + 1.5 - phase) / 8, u = (4 * x + 1.5 - phase) / 8;
          const int top = int(std::floor(v)), left = int(std::floor(u));
          const auto at = [&](int row, int column) {
            return double(low.at(c, std::clamp(row, 0, 4), std::clamp(column, 0, 6)));
          };
          const auto along = [&](int row) {
            return at(row, left) * (left + 1 - u) + at(row, left + 1) * (u - left);
          };
          twice.at(c, y, x) = float(along(top) * (top + 1 - v) + along(top + 1) * (v - top));
        }
      }
    }
    write_image(folder_ / "twice.exr", kColorNames, twice, Imf::FLOAT);
    const nlohmann::json report =
        fuse_to("out.exr", "low.exr", sampling, "64", {"--reference", "reference.exr"});
    EXPECT_EQ(report.at("scale"), 8);
    const double bicubic = psnr_srgb(upsample_bicubic(low, 8, float(phase)), reference);
    EXPECT_NEAR(report.at("metrics").at("bicubic_lrhs").at("psnr_db").get<double>(), bicubic, 1e-3);
    EXPECT_EQ(report.at("lrhs_sampling"), sampling);
    fuse_to("twice-out.exr", "twice.exr", "centered", "16");
    const Image fused = read("out.exr"), expected = read("twice-out.exr");
    for (size_t i = 0; i < fused.data.size(); ++i)
      ASSERT_NEAR(fused.data[i], expected.data[i], 1e-4 * (1 + expected.data[i])) << sampling << " " << i;
    fuse_to("part.exr", "low.exr", sampling, "64", {"--window", "11,9,13,8"});
    EXPECT_EQ(read("part.exr").data, crop(fused, 11, 9, 13, 8).data);
  }
}

TEST_F(CliPair, WithoutEvidenceLrhsIsAnOrdinarySmallRender) {
  const nlohmann::json plan = planned();
  EXPECT_EQ(plan.at("lrhs_sampling"), "centered");
  EXPECT_EQ(plan.at("lrhs_sampling_from"), "default");
  EXPECT_NE(said().find("found: LRHS is an ordinary small render, as the pixels do not show another kind"),
            std::string::npos);
}

TEST_F(CliPair, FilesThatDoNotBelongTogetherAreRefused) {
  const Pair pair = make_pair(4, true);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  const Image noise = image_of(pair.lrhs.width, pair.lrhs.height, [&](int, int) { return uniform(random); });
  const std::vector<std::pair<Image, std::string>> strangers = {
      {turned(pair.lrhs, true, false), "left and right exchanged"},
      {turned(pair.lrhs, false, true), "top and bottom exchanged"},
      {turned(pair.lrhs, true, true), "turned by 180 degrees"},
      {noise, "the correlation of their structures is"},
      {mixed_with_another_camera(pair.lrhs, 1), "the correlation of their structures is"}};
  for (const auto& [lrhs, reason] : strangers) {
    write_pair(lrhs, pair.hrls);
    expect_error(fuse(), {"LRHS 'low.exr'", "HRLS 'high.exr'", reason, "--pair-check warn"});
    EXPECT_FALSE(std::filesystem::exists(folder_ / "out.exr"));
  }
  const std::string warned = said({"--pair-check", "warn"});
  EXPECT_NE(warned.find("warning: LRHS 'low.exr' and HRLS 'high.exr' show different things"),
            std::string::npos)
      << warned;
  EXPECT_EQ(said({"--pair-check", "off"}).find("warning"), std::string::npos);
}

TEST_F(CliPair, APairThatHardlyBelongsTogetherIsWarnedOf) {
  const Pair pair = make_pair(4, true);
  std::string warned;
  for (float share = 0.3f; share <= 1 && warned.empty(); share += 0.05f) {
    write_pair(mixed_with_another_camera(pair.lrhs, share), pair.hrls);
    const ProcessResult result = run(fuse());
    if (result.err.find("hardly resembles") != std::string::npos) {
      EXPECT_EQ(result.exit_status, 0);
      warned = result.err;
    }
  }
  EXPECT_NE(warned.find("warning: LRHS 'low.exr' hardly resembles HRLS 'high.exr'"), std::string::npos);
}

// Either render may be the brighter one.
TEST_F(CliPair, LrhsIsMadeAsBrightAsHrls) {
  const Pair pair = make_pair(4, true);
  write_pair(pair.lrhs, times(pair.hrls, 4));
  EXPECT_NEAR(nlohmann::json::parse(run(fuse({"--json"})).out).at("lrhs_brightness").get<float>(), 4, 0.4);
  write_pair(pair);
  const Image honest = fused();
  for (const float factor : {0.25f, 4.0f}) {
    write_pair(times(pair.lrhs, factor), pair.hrls);
    const ProcessResult result = run(fuse({"--json"}));
    ASSERT_EQ(result.exit_status, 0) << result.err;
    EXPECT_NEAR(nlohmann::json::parse(result.out).at("lrhs_brightness").get<float>() * factor, 1, 0.1);
    EXPECT_NE(result.err.find("times as bright as HRLS 'high.exr'"), std::string::npos) << result.err;
    const Image found = fused(), given = fused({"--pair-check", "off"});
    double with = 0, without = 0;
    for (size_t i = 0; i < found.data.size(); ++i) {
      with += std::abs(double(found.data[i]) - honest.data[i]);
      without += std::abs(double(given.data[i]) - honest.data[i]);
    }
    EXPECT_LT(with, 0.1 * without);
  }
}

TEST_F(CliPair, AWindowIsFusedAsTheWholeFrameIs) {
  const Pair pair = make_pair(4, false);
  write_pair(times(pair.lrhs, 3), pair.hrls);
  const std::vector<std::string> kernels = {"--kernels", "direct"};
  const Image whole = fused(kernels);
  const Image part = fused({"--kernels", "direct", "--window", "16,32,24,20"});
  EXPECT_EQ(part.data, crop(whole, 16, 32, 24, 20).data);
}

TEST_F(CliPair, DataWindowsThatContradictEachOtherAreSaid) {
  const Pair pair = make_pair(4, true);
  write_pair(pair);
  const Imath::Box2i data = window(40, 30, pair.lrhs.width, pair.lrhs.height),
                     display = window(0, 0, 500, 400);
  write_image(folder_ / "low.exr", kColorNames, pair.lrhs, data, display);
  const std::string text = said();
  EXPECT_NE(text.find("the data windows start at different places"), std::string::npos) << text;
}

TEST_F(CliPair, EachFrameOfASequenceIsCheckedByItself) {
  const Pair pair = make_pair(4, true);
  write_pair(pair);
  for (const char* name : {"low", "high"})
    std::filesystem::copy(folder_ / fmt::format("{}.exr", name), folder_ / fmt::format("{}.1.exr", name));
  write_pair(turned(pair.lrhs, true, false), pair.hrls);
  for (const char* name : {"low", "high"})
    std::filesystem::copy(folder_ / fmt::format("{}.exr", name), folder_ / fmt::format("{}.2.exr", name));
  const ProcessResult result = run({"fuse", "--lrhs", "low.#.exr", "--hrls", "high.#.exr", "-o", "out.#.exr",
                                    "--model", tiny_model(), "--frames", "1-2"});
  EXPECT_EQ(result.exit_status, 2) << result.err;
  EXPECT_NE(result.err.find("frame 2: LRHS 'low.2.exr' and HRLS 'high.2.exr' show different things"),
            std::string::npos)
      << result.err;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out.1.exr"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.2.exr"));
}

}  // namespace
}  // namespace raymeld::test
