// Tests the shipped models on a part of a real pair of renders, data/.
#include "cli_fixture.h"

namespace raymeld::test {
namespace {

// Every scale divides these sizes.
constexpr int kLeft = 160, kTop = 160, kSize = 192;

std::vector<std::string> stock_models() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(source_path("models")))
    if (entry.path().extension() == ".safetensors") names.push_back(entry.path().stem());
  std::sort(names.begin(), names.end());
  return names;
}

// Holds a model's figures on that part. Another model under its name would give others.
struct Measured {
  double psnr_db;
};
const std::map<std::string, Measured> kMeasured = {
    {"x2-fast", {.psnr_db = 34.156}},     {"x4-balanced", {.psnr_db = 33.221}},
    {"x4-fast", {.psnr_db = 33.177}},     {"x4-faster", {.psnr_db = 32.971}},
    {"x8-balanced", {.psnr_db = 31.509}}, {"x8-fast", {.psnr_db = 31.612}}};

TEST(StockModels, AreAllKnownHere) {
  std::vector<std::string> names;
  for (const auto& [name, measured] : kMeasured) names.push_back(name);
  EXPECT_EQ(stock_models(), names);
}

class StockModelTest : public Cli, public testing::WithParamInterface<std::string> {
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
  const std::string scale = GetParam().substr(1, 1);
  const std::string lrhs = "lrhs-x" + scale + ".exr";
  cut(lrhs, std::stoi(scale));
  cut("hrls.exr", 1);
  cut("reference.exr", 1);
  const auto metrics =
      run_json({"fuse", "--json", "--model", source_path("models/" + GetParam() + ".safetensors"), "--lrhs",
                lrhs, "--hrls", "hrls.exr", "--reference", "reference.exr", "-o", "fused.exr"})["metrics"];
  const auto value = [&](const char* image, const char* metric) {
    return metrics[image][metric].get<double>();
  };
  EXPECT_NEAR(value("fused", "psnr_db"), kMeasured.at(GetParam()).psnr_db, 0.01);
  struct Gain {
    const char* input;
    double psnr_db, relmse_ratio;
  };
  const Gain least[] = {
      {.input = "bicubic_lrhs", .psnr_db = 3, .relmse_ratio = 3},
      {.input = "hrls", .psnr_db = 8, .relmse_ratio = 8},
  };
  for (const auto& [input, psnr_db, relmse_ratio] : least) {
    SCOPED_TRACE(input);
    EXPECT_GT(value("fused", "psnr_db"), value(input, "psnr_db") + psnr_db);
    EXPECT_LT(value("fused", "relmse_bcr"), value(input, "relmse_bcr") / relmse_ratio);
  }
}

INSTANTIATE_TEST_SUITE_P(Shipped, StockModelTest, testing::ValuesIn(stock_models()), [](const auto& test) {
  std::string name = test.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

}  // namespace
}  // namespace raymeld::test
