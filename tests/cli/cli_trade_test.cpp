// Tests `trade`, which must measure what fuse computes.
#include <fmt/format.h>

#include <cmath>
#include <csignal>
#include <fstream>
#include <set>

#include "choice/curve.h"
#include "cli_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class CliTrade : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    fs::create_directory(folder_ / "models");
    environment_["RAYMELD_MODELS"] = (folder_ / "models").string();
    fs::copy_file(tiny_model(), folder_ / "models/x4-tiny.safetensors");
  }

  // Writes a view of 32 x 24 pixels with two LRHS and two HRLS renders. A render takes 0.5 s and 1 s per
  // sample of a full-size pixel; LRHS takes 1/16 of that.
  void write_view(const std::string& name, uint64_t seed) const {
    const fs::path view = folder_ / name;
    fs::create_directories(view);
    const Image reference = random_image(kLayeredNames, 32, 24, seed);
    Image noisy = random_image(kLayeredNames, 32, 24, seed + 1), cleaner = noisy;
    for (size_t i = 0; i < noisy.data.size(); ++i) {
      noisy.data[i] = std::lerp(reference.data[i], noisy.data[i], 0.25f);
      cleaner.data[i] = std::lerp(reference.data[i], cleaner.data[i], 0.125f);
    }
    write_image(view / "reference-a.exr", kLayeredNames, reference);
    write_image(view / "reference-b.exr", kLayeredNames, reference);
    write_image(view / "0001.exr", kLayeredNames, noisy);
    write_image(view / "0002.exr", kLayeredNames, cleaner);
    write_image(view / "guides-0004.exr", kLayeredNames, cleaner);
    for (const char* spp : {"0016", "0032"})
      write_image(view / fmt::format("lrhs-x4-{}.exr", spp), kColorNames, degrade_nearest(reference, 4));
    write_file(view / "view.json", R"({"files": {
      "reference-a.exr": {"spp": 256, "seconds": 256.5}, "reference-b.exr": {"spp": 256, "seconds": 256.5},
      "guides-0004.exr": {"spp": 4, "seconds": 0.5, "layers": "guides"},
      "0001.exr": {"spp": 1, "seconds": 1.5, "layers": "fusion"}, "0002.exr": {"spp": 2, "seconds": 2.5, "layers": "fusion"},
      "lrhs-x4-0016.exr": {"spp": 16, "scale": 4, "seconds": 1.03125}, "lrhs-x4-0032.exr": {"spp": 32, "scale": 4, "seconds": 2.03125}
    }})");
  }

  Json read_json(const std::string& name) const { return Json::parse(read_file(folder_ / name)); }

  // Expects each point of the front, and no other, to bring 0.01 dB more than the cheaper one before it.
  template <typename Cost>
  static void expect_front(const Json& points, const Cost& cost, const char* key) {
    constexpr double kStepDb = 0.01;
    const auto psnr = [](const Json& point) { return point.at("psnr_db").get<double>(); };
    for (const Json& point : points) {
      const bool beaten = std::ranges::any_of(points, [&](const Json& other) {
        return &other != &point && other.at(key) && cost(other) <= cost(point) &&
               psnr(other) > psnr(point) - kStepDb;
      });
      EXPECT_EQ(point.at(key), !beaten) << point;
    }
  }

  ProcessResult trade(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"trade", "--data", "set", "--model", "x4-tiny", "-o", "report"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run(arguments);
  }
};

TEST_F(CliTrade, OrdinarySmallRendersComeBeforeDecimatedOnes) {
  write_view("set", 5);
  fs::copy_file(folder_ / "set/lrhs-x4-0016.exr", folder_ / "set/lowres-x4-0024.exr");
  Json view = read_json("set/view.json");
  view["files"]["lowres-x4-0024.exr"] = {{"spp", 24}, {"scale", 4}, {"seconds", 1.5}};
  write_file(folder_ / "set/view.json", view.dump());
  const ProcessResult result = trade();
  ASSERT_EQ(result.exit_status, 0) << result.err;
  const Json report = read_json("report/trade.json");
  ASSERT_FALSE(report.at("settings").empty());
  for (const Json& setting : report.at("settings")) EXPECT_EQ(setting.at("lrhs_spp"), 24);
}

TEST_F(CliTrade, WritesWhatFuseGives) {
  write_view("set/one", 5);
  write_view("set/two", 9);
  const ProcessResult result = trade();
  ASSERT_EQ(result.exit_status, 0) << result.err;
  const Json report = read_json("report/trade.json");
  EXPECT_EQ(report.at("data"), "set");
  EXPECT_EQ(report.at("views").size(), 2u);
  const Json& settings = report.at("settings");
  ASSERT_GE(settings.size(), 2u);  // 4 where the device has fp16
  EXPECT_EQ(report.at("measurements").size(), 2 * settings.size());
  std::string row;
  size_t rows = 0;
  for (std::ifstream csv(folder_ / "report/trade.csv"); std::getline(csv, row);) ++rows;
  EXPECT_EQ(rows, 1 + 2 * settings.size());

  for (const Json& setting : settings) {
    EXPECT_EQ(setting.at("scale"), 4);
    EXPECT_EQ(setting.at("lrhs_spp"), 16);
    EXPECT_EQ(setting.at("hrls_spp"), 1);
    const Json& time = setting.at("time_ms");
    EXPECT_GT(time.at("lower"), 0);
    EXPECT_LE(time.at("lower"), time.at("median"));
    EXPECT_LE(time.at("median"), time.at("upper"));
    const bool half = setting.at("precision") == "fp16";
    EXPECT_LT(setting.at("fp64_error"), half ? 10 : 0.01) << setting;
    EXPECT_GT(setting.at("fp64_error"), 0) << setting;
  }
  expect_front(
      report.at("settings"), [](const Json& p) { return p.at("time_ms").at("median").get<double>(); },
      "time_front");
  expect_front(
      report.at("settings"), [](const Json& p) { return p.at("memory_bytes").get<double>(); },
      "memory_front");
  expect_front(
      report.at("renders"),
      [](const Json& p) { return p.at("render_s").get<double>() + p.at("fuse_s").get<double>(); }, "front");
  // Fuses each view by each setting, which must give the measured image.
  for (const Json& measured : report.at("measurements")) {
    const Json& setting = settings.at(measured.at("setting").get<size_t>());
    const std::string view = "set/" + measured.at("view").get<std::string>() + "/";
    const Json fused = run_json({"fuse",
                                 "--lrhs",
                                 view + "lrhs-x4-0016.exr",
                                 "--hrls",
                                 view + "0001.exr",
                                 "-o",
                                 "out.exr",
                                 "--model",
                                 "x4-tiny",
                                 "--reference",
                                 view + "reference-a.exr",
                                 "--json",
                                 "--output-type",
                                 "float",
                                 "--precision",
                                 setting.at("precision"),
                                 "--overflow",
                                 "redo",
                                 "--kernels",
                                 setting.at("kernels")});
    EXPECT_NEAR(fused.at("metrics").at("fused").at("psnr_db").get<double>(),
                measured.at("psnr_db").get<double>(), 1e-4)
        << setting;
  }
}

TEST_F(CliTrade, GoesOnWhereItWasStopped) {
  write_view("set", 3);
  const fs::path journal = folder_ / "report/measured.jsonl";
  const auto stop = [&] {
    const ProcessResult result =
        run_process({RAYMELD_PROGRAM, "trade", "--data", "set", "--model", "x4-tiny", "-o", "report"},
                    {.directory = folder_.path(),
                     .environment = environment_,
                     .signal = SIGKILL,
                     .signal_after = "pairs of renders"});
    EXPECT_EQ(result.signal, SIGKILL) << result.err;
    EXPECT_FALSE(fs::exists(folder_ / "report/trade.json"));
  };
  stop();
  // All settings of the one view are measured by then. A line that was cut off in writing does not count.
  std::map<std::string, Json> measured;
  std::string line;
  for (std::ifstream lines(journal); std::getline(lines, line);) {
    const Json json = Json::parse(line);
    if (json.is_array()) measured[json[0]] = json[1];
  }
  ASSERT_GE(measured.size(), 2u * 2);
  std::ofstream(journal, std::ios::app) << R"(["set: 1 spp", [)";
  const ProcessResult result = trade();
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_NE(result.err.find(fmt::format("continuing after {} measurements", measured.size())),
            std::string::npos)
      << result.err;
  EXPECT_FALSE(fs::exists(journal));
  const Json report = read_json("report/trade.json");
  std::multiset<double> expected, times;
  for (const auto& [name, values] : measured) {
    if (name.starts_with("set: x4-tiny") && name.find("spp") == std::string::npos)
      expected.insert(values[0].get<double>());
  }
  for (const Json& one : report.at("measurements")) times.insert(one.at("time_ms").get<double>());
  EXPECT_EQ(times, expected);
  EXPECT_EQ(report.at("renders").size(), 5u);

  // Measurements of other renders are not used.
  fs::remove_all(folder_ / "report");
  stop();
  fs::last_write_time(folder_ / "set/0002.exr", fs::file_time_type::clock::now() + std::chrono::seconds(9));
  const ProcessResult anew = trade();
  EXPECT_EQ(anew.exit_status, 0);
  EXPECT_EQ(anew.err.find("continuing"), std::string::npos) << anew.err;
}

TEST_F(CliTrade, RendersCostWhatTheLineThroughTheirTimesSays) {
  write_view("set", 3);
  ASSERT_EQ(trade().exit_status, 0);
  const Json report = read_json("report/trade.json");
  std::map<std::string, double> seconds;
  for (const Json& render : report.at("renders")) {
    seconds[fmt::format("{} {}-{}", render.at("model").get<std::string>(), render.at("lrhs_spp").get<int>(),
                        render.at("hrls_spp").get<int>())] = render.at("render_s");
    EXPECT_EQ(render.at("fuse_s") == 0, render.at("model") == "");
  }
  // LRHS of 32 samples a pixel has more samples in all than HRLS of one, so they are no pair.
  ASSERT_EQ(seconds.size(), 5u);
  EXPECT_NEAR(seconds.at(" 0-1"), 1.5, 1e-3);
  EXPECT_NEAR(seconds.at(" 0-2"), 2.5, 1e-3);
  EXPECT_NEAR(seconds.at("x4-tiny 16-1"), 1.5 + 16.5 / 16, 1e-3);
  EXPECT_NEAR(seconds.at("x4-tiny 16-2"), 2.5 + 16.5 / 16, 1e-3);
  EXPECT_NEAR(seconds.at("x4-tiny 32-2"), 2.5 + 32.5 / 16, 1e-3);
}

TEST_F(CliTrade, ThePageHoldsTheMeasurementsAndNothingFromElsewhere) {
  write_view("set", 3);
  ASSERT_EQ(trade({"--quick"}).exit_status, 0);
  const std::string page = read_file(folder_ / "report/trade.html");
  const std::string begin = "<script type=\"application/json\" id=\"data\">";
  const size_t at = page.find(begin) + begin.size();
  Json data = Json::parse(page.substr(at, page.find("</script>", at) - at));
  const Json strips = data.at("strips");
  data.erase("strips");
  EXPECT_EQ(data, read_json("report/trade.json"));
  ASSERT_EQ(strips.size(), 1u);
  EXPECT_EQ(strips[0].at("images"), Json({"LRHS, bicubic", "HRLS", "x4-tiny", "reference"}));
  EXPECT_EQ(strips[0].at("width"), 4 * 32 + 3 * 4);
  EXPECT_EQ(strips[0].at("height"), 2 * 24);
  EXPECT_TRUE(strips[0].at("png").get<std::string>().starts_with("iVBORw0KGgo"));  // the first bytes of a PNG
}

TEST_F(CliTrade, CurveIsWrittenForFuseToChooseBy) {
  for (uint64_t view = 0; view < 8; ++view) write_view(fmt::format("set/{}", view), 10 * view);
  const CurvePoint of_another_task{"x4-up", 4, 1, 20, Task::kUpscale}, measured_anew{"x4-tiny", 4, 1, 20};
  save_curve(folder_ / "models/curve.json", {"", "", {measured_anew, of_another_task}});
  ASSERT_EQ(trade({"--curve", "models/curve.json"}).exit_status, 0);
  const Json curve = read_json("models/curve.json"), report = read_json("report/trade.json");
  ASSERT_EQ(curve.at("points").size(), 2u);
  EXPECT_EQ(curve.at("points")[1].at("model"), "x4-up");
  EXPECT_EQ(curve.at("points")[0].at("model"), "x4-tiny");
  EXPECT_EQ(curve.at("points")[0].at("psnr_db"), report.at("settings")[0].at("psnr_db"));
  EXPECT_EQ(curve.at("points")[0].at("time_ms"), report.at("settings")[0].at("time_ms").at("median"));
  const Json fused = run_json(
      {"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "-o", "out.exr", "--quality", "high", "--json"});
  EXPECT_EQ(fused.at("choice").at("model"), "x4-tiny");
}

TEST_F(CliTrade, BadSetsAreErrorsThatNameThem) {
  const auto expect_error = [&](const std::vector<std::string>& more, const char* text) {
    const ProcessResult result = trade(more);
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    EXPECT_FALSE(fs::exists(folder_ / "report/trade.html"));
  };
  expect_error({}, "test set 'set': there is no view.json in it");
  write_view("set", 3);
  write_file(folder_ / "set/view.json", "{");
  expect_error({}, "test set 'set/view.json': ");
  write_file(folder_ / "set/view.json", R"({"files": {"0003.exr": {"spp": 3}}})");
  expect_error({}, "there is no file 0003.exr");
  write_file(folder_ / "set/view.json", R"({"files": {"0001.exr": {"spp": 1, "layers": "fusion"}}})");
  expect_error({}, "there are 1 HRLS, 0 LRHS and 0 references");
}

}  // namespace
}  // namespace raymeld::test
