// Kills runs with kill -9 at random moments. Each output is then whole, as it was before, or absent.
#include <fmt/format.h>

#include <csignal>
#include <random>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;

using Contents = std::map<std::string, std::string>;

class Kill : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 64, 48, 1));
    write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 256, 192, 2));
    inputs_ = files();
  }

  ProcessResult run_killed(const std::string& after, std::chrono::microseconds delay) const {
    std::vector<std::string> arguments = fuse(kOutputs);
    arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
    return run_process(arguments, {.directory = folder_.path(),
                                   .environment = environment_,
                                   .signal = SIGKILL,
                                   .signal_after = after,
                                   .signal_delay = delay});
  }

  // Returns all files but the inputs, with those in the folder of layers as "layers/...".
  Contents outputs() const {
    Contents result;
    for (const std::string& name : files()) {
      if (inputs_.contains(name)) continue;
      if (!fs::is_directory(folder_ / name)) result[name] = read_file(folder_ / name);
    }
    if (!fs::exists(folder_ / "layers")) return result;
    for (const auto& entry : fs::directory_iterator(folder_ / "layers"))
      result["layers/" + entry.path().filename().string()] = read_file(entry.path());
    return result;
  }

  void remove_outputs() const {
    for (const auto& [name, content] : outputs()) fs::remove(folder_ / name);
    fs::remove(folder_ / "layers");
  }

  inline static const std::vector<std::string> kOutputs = {
      "--preview", "preview.png", "--preview-before-after", "both.png", "--dump", "layers", "--keep-layers"};
  std::set<std::string> inputs_;
};

// RAYMELD_TEST_KILLS is the least number of runs. More follow until one was killed and an image appeared.
TEST_F(Kill, LeavesTheWholeOutputOrNone) {
  const char* asked = std::getenv("RAYMELD_TEST_KILLS");
  const int kills = asked ? std::atoi(asked) : full_extent() ? 25 : 6;
  constexpr int kMostMore = 100;
  constexpr unsigned kSeed = 1;
  ASSERT_EQ(run(fuse(kOutputs)).exit_status, 0);
  const Contents expected = outputs();
  ASSERT_TRUE(expected.contains("out.exr") && expected.contains("layers/decode.npy"));
  const auto start = std::chrono::steady_clock::now();
  ASSERT_EQ(run(fuse(kOutputs)).exit_status, 0);
  const std::chrono::duration<double, std::milli> typical = std::chrono::steady_clock::now() - start;
  // Estimates when a run ends, counted from its start and from "fusing". Each run corrects the estimate, as a
  // machine is not always as busy.
  std::array<double, 2> end_ms = {typical.count(), 0.5 * typical.count()};
  std::mt19937 random(kSeed);
  int killed = 0, appeared = 0, partly = 0, left_behind = 0;
  int i = 0;
  for (; i < kills || ((killed == 0 || appeared == 0) && i < kills + kMostMore); ++i) {
    SCOPED_TRACE(fmt::format("kill {} of seed {}", i, kSeed));
    remove_outputs();
    const bool replaces = i % 2 == 1;
    if (replaces) {
      fs::create_directory(folder_ / "layers");
      for (const auto& [name, content] : expected) write_file(folder_ / name, "older " + name);
    }
    // Half of the kills come anywhere in a run, and half about when it writes.
    const bool late = i % 4 >= 2;
    double& end = end_ms[late];
    const double delay_ms = std::uniform_real_distribution(late ? 0.6 * end : 0.0, 1.2 * end)(random);
    const ProcessResult result =
        run_killed(late ? "fusing" : "", std::chrono::microseconds(int64_t(1000 * delay_ms)));
    if (result.signal == 0) {
      end = std::min(end, delay_ms);
    } else {
      end = std::max(1.1 * end, delay_ms);
    }
    killed += result.signal == SIGKILL;
    ASSERT_TRUE(result.signal == SIGKILL || result.exit_status == 0) << result.err;

    size_t whole = 0;
    const Contents found = outputs();
    for (const auto& [name, content] : found) {
      if (!expected.contains(name)) {
        EXPECT_NE(name.find(".raymeld-"), std::string::npos) << name;
        ++left_behind;
        continue;
      }
      const bool is_new = content == expected.at(name);
      EXPECT_TRUE(is_new || (replaces && content == "older " + name)) << name;
      whole += is_new;
    }
    const bool has_image = found.contains("out.exr") && found.at("out.exr") == expected.at("out.exr");
    EXPECT_TRUE(!has_image || whole == expected.size()) << "the image comes last";
    EXPECT_TRUE(has_image || result.signal == SIGKILL);
    appeared += has_image, partly += !has_image && whole > 0;
  }
  ASSERT_EQ(run(fuse(kOutputs)).exit_status, 0);  // starts from the files that the last kill left
  for (const auto& [name, content] : expected) EXPECT_EQ(outputs()[name], content) << name;
  EXPECT_GT(killed, 0);
  EXPECT_GT(appeared, 0);
  fmt::print(
      "seed {}: {} runs, {} killed; image whole after {}, other outputs only after {}; {} temporary files "
      "left\n",
      kSeed, i, killed, appeared, partly, left_behind);
}

}  // namespace
}  // namespace raymeld::test
