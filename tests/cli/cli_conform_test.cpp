#include "cli_fixture.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

// Checks the sums in text and in JSON.
TEST_F(Cli, ConformSumsUpWhatItFound) {
  const Json json = run_json({"conform", "--suite", "pyramid", "--json"});
  EXPECT_EQ(json.at("extent"), "quick");
  EXPECT_EQ(json.at("failed"), 0);
  EXPECT_EQ(json.at("failures"), Json::array());
  const std::set<std::string> layers{"light", "cell_light", "pool", "kernel_filter", "compose"};
  size_t passed = 0;
  for (const Json& row : json.at("rows")) {
    EXPECT_TRUE(layers.contains(row.at("layer"))) << row;
    passed += row.at("passed").get<size_t>();
  }
  EXPECT_GT(passed, 0u);
  EXPECT_EQ(json.at("passed"), passed);

  const ProcessResult text = run({"conform", "--suite", "pyramid"});
  EXPECT_EQ(text.exit_status, 0);
  EXPECT_NE(text.out.find("kernel_filter"), std::string::npos);
  EXPECT_NE(text.out.find(std::to_string(passed) + " cases passed, 0 failed"), std::string::npos) << text.out;
}

// The other device's file has wrong values for one network, which fail; missing networks are unsupported.
TEST_F(Cli, ConformComparesNetworksWithThoseOfAnotherDevice) {
  const char* network = "0: x2, 1 features, phase 0, 1 x 1, direct, fp32";
  const Json known{{"shape", {3, 2, 2}}, {"values", std::vector<double>(12, 1e6)}};
  write_file(folder_ / "other.json", Json{{"device", "another"}, {"outputs", {{network, known}}}}.dump());
  const ProcessResult result =
      run({"conform", "--suite", "network", "--json", "--values", "values.json", "--against", "other.json"});
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("1 of the device's cases failed"), std::string::npos) << result.err;
  const Json json = Json::parse(result.out), values = Json::parse(read_file(folder_ / "values.json"));
  EXPECT_TRUE(values.at("outputs").contains(network));
  size_t unsupported = 0;
  for (const Json& row : json.at("rows"))
    if (row.at("layer") == "agreement with another") unsupported += row.at("unsupported").get<size_t>();
  EXPECT_GT(unsupported, 2u);
  EXPECT_EQ(unsupported, values.at("outputs").size() - 1);
  ASSERT_EQ(json.at("failures").size(), 1u);
  EXPECT_EQ(json.at("failures").at(0).at("layer"), "agreement with another");
}

TEST_F(Cli, ConformKeepsAndComparesNothingWithoutNetworks) {
  for (const char* option : {"--values", "--against"}) {
    const ProcessResult result = run({"conform", "--suite", "pyramid,kpcn", option, "values.json"});
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_NE(result.err.find("--values and --against need the suite 'network'"), std::string::npos)
        << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_FALSE(std::filesystem::exists(folder_ / "values.json"));
  }
}

}  // namespace
}  // namespace raymeld::test
