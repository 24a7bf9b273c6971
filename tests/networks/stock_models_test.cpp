// Tests the shipped models on a part of a real pair of renders, data/.
#include <fmt/format.h>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

// Every scale divides these sizes.
constexpr int kLeft = 160, kTop = 160, kSize = 192;

std::set<std::string> stock_models() {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(source_path("models")))
    if (entry.path().extension() == ".safetensors") names.insert(entry.path().stem());
  return names;
}

// Holds a model's PSNR with the pair of a scale, with HRLS alone at a scale of 1, or with LRHS alone. Another
// model under its name would have another.
struct Measured {
  std::string model;
  int scale;
  double psnr_db;
  bool reads_hrls = true;
};
const std::vector<Measured> kMeasured = {
    {"denoise-balanced", 1, 32.926}, {"denoise-kpcn", 1, 32.813},   {"x2-balanced", 2, 34.329},
    {"x2-fast", 2, 34.073},          {"x4-balanced", 4, 33.148},    {"x4-balanced", 8, 32.923},
    {"x4-fast", 4, 32.892},          {"x4-fast", 8, 32.572},        {"x2-edsr", 2, 31.342, false},
    {"x4-edsr", 4, 28.989, false},   {"x4-rcan", 4, 29.102, false},
};

TEST(StockModels, AreAllKnownHere) {
  std::set<std::string> names;
  for (const Measured& measured : kMeasured) names.insert(measured.model);
  EXPECT_EQ(stock_models(), names);
}

class StockModelTest : public Cli, public testing::WithParamInterface<Measured> {
 protected:
  // Cuts the part of the scene out of data/NAME, which has 1/scale of the full size.
  void cut(const std::string& name, int scale) const {
    ExrFile file(source_path("data/" + name));
    const std::vector<std::string> channels = file.channel_names();
    const Image part = crop(file.read(channels), kLeft / scale, kTop / scale, kSize / scale, kSize / scale);
    write_image(folder_ / name, channels, part, Imf::FLOAT);
  }
};

TEST_P(StockModelTest, BeatsBothOfItsInputs) {
  const auto& [model, scale, psnr_db, reads_hrls] = GetParam();
  const std::string lrhs = fmt::format("lrhs-x{}.exr", scale);
  std::vector<std::string> arguments = {!reads_hrls ? "upscale" : scale > 1 ? "fuse" : "denoise"};
  if (scale > 1) {
    cut(lrhs, scale);
    arguments.insert(arguments.end(), {"--lrhs", lrhs});
  }
  if (reads_hrls) {
    cut("hrls.exr", 1);
    arguments.insert(arguments.end(), {"--hrls", "hrls.exr"});
  }
  cut("reference.exr", 1);
  arguments.insert(arguments.end(), {"--json", "--model", source_path("models/" + model + ".safetensors"),
                                     "--reference", "reference.exr", "-o", "fused.exr"});
  const auto metrics = run_json(arguments)["metrics"];
  const auto value = [&](const char* image, const char* metric) {
    return metrics[image][metric].get<double>();
  };
  EXPECT_NEAR(value("fused", "psnr_db"), psnr_db, 0.01);
  struct Gain {
    const char* input;
    double psnr_db, relmse_ratio;
  };
  const Gain least[] = {
      {.input = "bicubic_lrhs", .psnr_db = reads_hrls ? 3.0 : 0.5, .relmse_ratio = reads_hrls ? 2.5 : 1.2},
      {.input = "hrls", .psnr_db = 8, .relmse_ratio = 8},
  };
  for (const auto& [input, lead_db, relmse_ratio] : least) {
    if (!metrics.contains(input)) continue;
    SCOPED_TRACE(input);
    EXPECT_GT(value("fused", "psnr_db"), value(input, "psnr_db") + lead_db);
    EXPECT_LT(value("fused", "relmse_bcr"), value(input, "relmse_bcr") / relmse_ratio);
  }
}

INSTANTIATE_TEST_SUITE_P(Shipped, StockModelTest, testing::ValuesIn(kMeasured), [](const auto& test) {
  std::string name = test.param.model;
  std::replace(name.begin(), name.end(), '-', '_');
  return fmt::format("{}_with_x{}", name, test.param.scale);
});

}  // namespace
}  // namespace raymeld::test
