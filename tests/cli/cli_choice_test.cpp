// Tests how fuse chooses a model by --quality or --budget.
#include <fmt/format.h>

#include "choice/curve.h"
#include "cli_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr double kHour = 3.6e6;

// Has three models that are copies of one file; the curve says how they differ.
class CliChoice : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    fs::create_directory(folder_ / "models");
    environment_["RAYMELD_MODELS"] = (folder_ / "models").string();
    for (const char* name : {"x4-a", "x4-b", "x4-c"})
      fs::copy_file(tiny_model(), folder_ / fmt::format("models/{}.safetensors", name));
    save_curve(folder_ / "models/curve.json",
               {.device = "device",
                .data = "set",
                .points = {{.model = "x4-c", .scale = 4, .time_ms = 80, .psnr_db = 30.21},
                           {.model = "x4-a", .scale = 4, .time_ms = 10, .psnr_db = 30},
                           {.model = "x4-b", .scale = 4, .time_ms = 20, .psnr_db = 30.2}}});
  }

  static std::vector<std::string> request(const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "out.exr"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  Json chosen(const std::string& option, const std::string& value) const {
    return run_json(request({option, value, "--json"})).at("choice");
  }
};

TEST_F(CliChoice, ByQuality) {
  EXPECT_EQ(chosen("--quality", "fast").at("model"), "x4-a");
  EXPECT_EQ(chosen("--quality", "0").at("model"), "x4-a");
  EXPECT_EQ(chosen("--quality", "balanced").at("model"), "x4-b");
  EXPECT_EQ(chosen("--quality", "33").at("model"), "x4-a");
  EXPECT_EQ(chosen("--quality", "96.5").at("model"), "x4-c");
  const Json high = chosen("--quality", "high");
  EXPECT_EQ(high.at("model"), "x4-c");
  EXPECT_EQ(high.at("loss_db"), 0);
  EXPECT_FALSE(high.contains("time_ms"));  // no time was measured
  EXPECT_NEAR(chosen("--quality", "fast").at("loss_db"), 0.21, 1e-9);
}

TEST_F(CliChoice, WithoutARequestItIsTheBalancedOne) {
  fs::remove(folder_ / "models/x4-a.safetensors");
  write_file(folder_ / "models/x4-b.safetensors", "");  // the error then names it
  const ProcessResult result = run(request({}));
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("x4-b.safetensors"), std::string::npos) << result.err;
  EXPECT_NE(run(request({"--model", "x4"})).err.find("x4-b.safetensors"), std::string::npos);
}

TEST_F(CliChoice, PairsOfX8AreFusedByAModelOfX4) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 4, 3, 1));
  EXPECT_EQ(chosen("--quality", "high").at("model"), "x4-c");
  EXPECT_EQ(run_json(request({"--json"})).at("scale"), 8);
  // A model of x8 comes before them.
  save_curve(folder_ / "models/curve.json",
             {.device = "device",
              .data = "set",
              .points = {{.model = "x4-a", .scale = 4, .time_ms = 10, .psnr_db = 30},
                         {.model = "x8-a", .scale = 8, .time_ms = 20, .psnr_db = 29}}});
  fs::copy_file(tiny_model(), folder_ / "models/x8-a.safetensors");
  EXPECT_EQ(chosen("--quality", "fast").at("model"), "x8-a");
}

TEST_F(CliChoice, FusesWithTheChosenModelAndSaysSo) {
  const ProcessResult result = run(request({"--quality", "fast"}));
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_NE(result.err.find("--quality 0: x4-a, 0.21 dB below x4-c, the best of 3"), std::string::npos)
      << result.err;
  ASSERT_EQ(run({"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "plain.exr", "--model", "x4-a"})
                .exit_status,
            0);
  EXPECT_EQ(read_file(folder_ / "out.exr"), read_file(folder_ / "plain.exr"));
}

TEST_F(CliChoice, BudgetIsMeasuredOnceAndKept) {
  const ProcessResult first = run(request({"--budget", "3600s"}));
  ASSERT_EQ(first.exit_status, 0) << first.err;
  EXPECT_NE(first.err.find("measuring x4-c at 32 x 24"), std::string::npos) << first.err;
  EXPECT_EQ(first.err.find("measuring x4-a"), std::string::npos) << first.err;  // its time is that of x4-c
  EXPECT_EQ(first.err.find("warning"), std::string::npos) << first.err;
  const ProcessResult second = run(request({"--budget", "3600s"}));
  EXPECT_EQ(second.err.find("measuring"), std::string::npos) << second.err;
  const Json enough = chosen("--budget", "3600s");
  EXPECT_EQ(enough.at("model"), "x4-c");
  EXPECT_GT(enough.at("time_ms"), 0);
  EXPECT_LT(enough.at("time_ms"), kHour);
  // Measured times serve --quality too.
  EXPECT_TRUE(chosen("--quality", "high").contains("time_ms"));
}

TEST_F(CliChoice, BudgetChoosesByTheTimesOfThisDevice) {
  ASSERT_EQ(run(request({"--budget", "1s"})).exit_status, 0);
  // Overwrites the measured times: 250 ms for the first frame and 100 ms for further ones.
  fs::path file;
  for (const auto& entry : fs::directory_iterator(folder_ / "cache/raymeld")) {
    if (entry.path().filename().string().starts_with("times-")) file = entry.path();
  }
  Json times = Json::parse(read_file(file));
  ASSERT_EQ(times.at("times_ms").size(), 1u);  // the three names are one model
  for (auto& [key, time_ms] : times.at("times_ms").items()) time_ms = {{"first", 250}, {"further", 100}};
  write_file(file, times.dump());
  const Json fits = chosen("--budget", "0.25s");
  EXPECT_EQ(fits.at("time_ms"), 250);
  EXPECT_EQ(fits.at("model"), "x4-c");
  const ProcessResult result = run(request({"--budget", "249ms"}));
  EXPECT_EQ(result.exit_status, 0);
  EXPECT_NE(result.err.find("--budget 249 ms is too short: the fastest model takes 250 ms"),
            std::string::npos)
      << result.err;
  fs::copy_file(folder_ / "high.exr", folder_ / "high.1.exr");
  const Json sequence = run_json({"fuse", "--lrhs", "low.exr", "--hrls", "high.#.exr", "-o", "out.#.exr",
                                  "--frames", "1-1", "--budget", "0.1s", "--json"});
  EXPECT_EQ(sequence.at("frames").at(0).at("choice").at("time_ms"), 100);
  // A file that cannot be read counts as none.
  write_file(file, "{");
  EXPECT_NE(run(request({"--budget", "1s"})).err.find("measuring"), std::string::npos);
}

TEST_F(CliChoice, SequencesTakeOneModel) {
  fs::copy_file(folder_ / "high.exr", folder_ / "high.1.exr");
  fs::copy_file(folder_ / "high.exr", folder_ / "high.2.exr");
  const Json json = run_json({"fuse", "--lrhs", "low.exr", "--hrls", "high.#.exr", "-o", "out.#.exr",
                              "--frames", "1-2", "--quality", "fast", "--json"});
  for (const Json& frame : json.at("frames")) EXPECT_EQ(frame.at("choice").at("model"), "x4-a");
  EXPECT_EQ(json.at("frames").size(), 2u);
}

TEST_F(CliChoice, RequestsThatCannotBe) {
  const auto expect_usage = [&](const std::vector<std::string>& arguments, const char* text) {
    const ProcessResult result = run(request(arguments));
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    EXPECT_FALSE(fs::exists(folder_ / "out.exr"));
  };
  for (const char* level : {"best", "-1", "101", "50 ", "nan", ""})
    expect_usage({"--quality", level}, "expected high, balanced, fast or a number from 0 to 100");
  for (const char* time : {"16", "0ms", "-1s", "2m", "ms", "infs"})
    expect_usage({"--budget", time}, "expected a time such as 16ms or 2s");
  expect_usage({"--target-psnr", "35"}, "--target-psnr: was removed");
  expect_usage({"--adaptive"}, "--adaptive: was removed");
  expect_usage({"--quality", "fast", "--budget", "1s"}, "excludes");
  expect_usage({"--quality", "fast", "--model", "x4-a"}, "excludes");
  write_file(folder_ / "models/curve.json", "[]");
  expect_usage({"--quality", "fast"}, "models/curve.json");
}

}  // namespace
}  // namespace raymeld::test
