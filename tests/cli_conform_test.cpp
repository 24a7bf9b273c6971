#include "cli_fixture.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

// As text and as JSON.
TEST_F(Cli, ConformSumsUpWhatItFound) {
  const Json json = run_json({"conform", "--suite", "shuffles", "--json"});
  EXPECT_EQ(json.at("extent"), "quick");
  EXPECT_EQ(json.at("failed"), 0);
  EXPECT_EQ(json.at("failures"), Json::array());
  size_t passed = 0;
  for (const Json& row : json.at("rows")) {
    EXPECT_NE(row.at("layer").get<std::string>().find("_"), std::string::npos) << row;
    passed += row.at("passed").get<size_t>();
  }
  EXPECT_GT(passed, 0u);
  EXPECT_EQ(json.at("passed"), passed);

  const ProcessResult text = run({"conform", "--suite", "shuffles"});
  EXPECT_EQ(text.exit_status, 0);
  EXPECT_NE(text.out.find("pixel_shuffle"), std::string::npos);
  EXPECT_NE(text.out.find(std::to_string(passed) + " cases passed, 0 failed"), std::string::npos) << text.out;
}

// A device agrees with itself; values that are not its own, or are not there, are no pass.
TEST_F(Cli, ConformComparesNetworksWithThoseOfAnotherDevice) {
  const std::vector<std::string> conform{"conform", "--suite", "network", "--json"};
  const auto with = [&](const std::string& option, const std::string& file) {
    std::vector<std::string> arguments = conform;
    arguments.insert(arguments.end(), {option, file});
    return run(arguments);
  };
  ASSERT_EQ(with("--values", "values.json").exit_status, 0);
  Json values = Json::parse(read_file(folder_ / "values.json"));
  Json& outputs = values.at("outputs");
  const size_t count = outputs.size();
  ASSERT_GT(count, 2u);
  Json& pixel = outputs.begin()->at("values").at(0);
  pixel = pixel.get<double>() + 1;
  outputs.erase(std::prev(outputs.end()));
  write_file(folder_ / "other.json", values.dump());

  const ProcessResult result = with("--against", "other.json");
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("1 of the device's cases failed"), std::string::npos) << result.err;
  const Json json = Json::parse(result.out);
  size_t passed = 0, unsupported = 0;
  for (const Json& row : json.at("rows")) {
    if (!row.at("layer").get<std::string>().starts_with("agreement with ")) continue;
    passed += row.at("passed").get<size_t>();
    unsupported += row.at("unsupported").get<size_t>();
  }
  EXPECT_EQ(passed, count - 2);
  EXPECT_EQ(unsupported, 1u);
  ASSERT_EQ(json.at("failures").size(), 1u);
  EXPECT_NE(json.at("failures").at(0).at("message").get<std::string>().find("c 0, y 0, x 0"),
            std::string::npos);
}

}  // namespace
}  // namespace raymeld::test
