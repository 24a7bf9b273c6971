// Tests the program on a driver that fails: exit status 2, a message that says what was being done, and no
// file. A layer between program and driver makes it fail (fault_layer/).
#include <fmt/format.h>
#include <vulkan/vulkan_core.h>

#include <fstream>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

class CliFaults : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    add_fault_layer();
    ASSERT_EQ(run(fuse()).exit_status, 0);  // compiles kernels, with calls that later runs do not make
    ASSERT_EQ(run(fuse()).exit_status, 0);
    std::filesystem::remove(folder_ / "out.exr");
    before_ = files();
    called_ = calls();
  }

  ProcessResult run_with_fault(const std::string& function, int call, VkResult code) {
    environment_["RAYMELD_FAULT"] = fmt::format("{} {} {}", function, call, int(code));
    std::filesystem::remove(folder_ / "cache" / "calls.txt");
    return run(fuse());
  }

  void expect_error(const ProcessResult& result, const std::string& text) const {
    EXPECT_EQ(result.exit_status, 2) << result.err;
    EXPECT_NE(result.err.find("raymeld: error: "), std::string::npos) << result.err;
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_EQ(files(), before_);
  }

  std::map<std::string, CallCount> called_;
  std::set<std::string> before_;
};

// Fails the first and the last call of every function that may fail, those that create the instance and the
// device included.
TEST_F(CliFaults, EveryFunctionThatFailsIsAnErrorAndLeavesNoFile) {
  EXPECT_GT(called_.size(), 20u);
  for (const auto& [function, count] : called_) {
    EXPECT_EQ(count.alive, 0) << function;
    for (const int call : std::set{1, count.calls}) {
      SCOPED_TRACE(fmt::format("{} {}", function, call));
      const ProcessResult result = run_with_fault(function, call, VK_ERROR_OUT_OF_HOST_MEMORY);
      if (function == "vkGetPipelineCacheData") {  // a cache on disk is not needed
        EXPECT_EQ(result.exit_status, 0);
        EXPECT_EQ(std::filesystem::remove(folder_ / "out.exr"), true);
        continue;
      }
      expect_error(result, "VK_ERROR_OUT_OF_HOST_MEMORY");
      if (function == "vkCreateInstance") continue;
      EXPECT_FALSE(calls().empty()) << "the instance was not destroyed";
      for (const auto& [made_by, after] : calls()) EXPECT_EQ(after.alive, 0) << made_by;
    }
  }
}

TEST_F(CliFaults, ALostDeviceIsAnErrorAndLeavesNoFile) {
  for (const char* function : {"vkCreateDevice", "vkQueueSubmit", "vkWaitForFences"}) {
    ASSERT_TRUE(called_.contains(function));
    SCOPED_TRACE(function);
    const ProcessResult result = run_with_fault(function, 1, VK_ERROR_DEVICE_LOST);
    expect_error(result, "VK_ERROR_DEVICE_LOST");
    EXPECT_NE(result.err.find("the driver has reset or lost the device"), std::string::npos) << result.err;
    for (const auto& [made_by, after] : calls()) EXPECT_EQ(after.alive, 0) << made_by;
  }
}

// The first submit of the second of three frames fails, so that the third is not begun.
TEST_F(CliFaults, ALostDeviceEndsASequence) {
  for (int frame = 1; frame <= 3; ++frame) {
    write_image(folder_ / fmt::format("low.{}.exr", frame), kColorNames, random_image(kColorNames, 8, 6, 1));
  }
  const std::string submit = fmt::format("vkQueueSubmit {}", called_.at("vkQueueSubmit").calls + 1);
  environment_["RAYMELD_FAULT"] = fmt::format("{} {}", submit, int(VK_ERROR_DEVICE_LOST));
  const ProcessResult result = run({"fuse", "--lrhs", "low.#.exr", "--hrls", "high.exr", "-o", "out.#.exr",
                                    "--model", tiny_model(), "--frames", "1-3"});
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("error: frame 2: "), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("VK_ERROR_DEVICE_LOST"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("3 frames: 1 fused, 1 failed (2), 1 unfinished (3)"), std::string::npos)
      << result.err;
  EXPECT_TRUE(files().contains("out.1.exr"));
  EXPECT_FALSE(files().contains("out.2.exr") || files().contains("out.3.exr"));
}

TEST_F(CliFaults, LittleMemoryGivesSmallTilesAndAWarning) {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 64, 48, 1));
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 256, 192, 2));
  const nlohmann::json whole = run_json(fuse({"--json"}));
  EXPECT_EQ(whole["tiles"], 1);
  EXPECT_TRUE(whole["warnings"].empty());

  const nlohmann::json plan = run_json(fuse({"--dry-run", "--json"}));
  const uint64_t activation_bytes = plan["activation_bytes"];
  environment_["RAYMELD_MOST_ALLOCATION"] = std::to_string(activation_bytes - 1);
  const nlohmann::json less = run_json(fuse({"--json"}));
  EXPECT_GT(less["tiles"], 1);
  EXPECT_EQ(less["warnings"].size(), 1u);
  const std::string tiled = read_file(folder_ / "out.exr");
  environment_["RAYMELD_MOST_ALLOCATION"] = "1000";
  std::filesystem::remove(folder_ / "out.exr");
  before_ = files();
  expect_error(run(fuse()), "VK_ERROR_OUT_OF_DEVICE_MEMORY");

  environment_.erase("RAYMELD_MOST_ALLOCATION");
  const uint64_t peak_bytes = plan["peak_bytes"];
  const nlohmann::json asked =
      run_json(fuse({"--json", "--max-memory", std::to_string((peak_bytes / 4 * 3) >> 20)}));
  EXPECT_EQ(asked["tiles"], less["tiles"]);
  EXPECT_EQ(read_file(folder_ / "out.exr"), tiled);
}

// The device has the memory that a small frame takes, and no tile of a large frame fits in it.
TEST_F(CliFaults, AFrameWithoutMemoryFailsAlone) {
  write_image(folder_ / "low.1.exr", kColorNames, random_image(kColorNames, 8, 6, 1));
  write_image(folder_ / "high.1.exr", kLayeredNames, random_image(kLayeredNames, 32, 24, 2));
  write_image(folder_ / "low.2.exr", kColorNames, random_image(kColorNames, 64, 48, 1));
  write_image(folder_ / "high.2.exr", kLayeredNames, random_image(kLayeredNames, 256, 192, 2));
  for (const char* name : {"low", "high"})
    std::filesystem::copy_file(folder_ / fmt::format("{}.1.exr", name),
                               folder_ / fmt::format("{}.3.exr", name));
  const nlohmann::json plan = run_json(fuse({"--dry-run", "--json"}));
  environment_["RAYMELD_MOST_ALLOCATION"] = std::to_string(plan["activation_bytes"].get<uint64_t>());
  const ProcessResult result = run({"fuse", "--lrhs", "low.#.exr", "--hrls", "high.#.exr", "-o", "out.#.exr",
                                    "--model", tiny_model(), "--frames", "1-3"});
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("error: frame 2: "), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("VK_ERROR_OUT_OF_DEVICE_MEMORY"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("3 frames: 2 fused, 1 failed (2)"), std::string::npos) << result.err;
  EXPECT_EQ(read_file(folder_ / "out.1.exr"), read_file(folder_ / "out.3.exr"));
  EXPECT_FALSE(files().contains("out.2.exr"));
}

}  // namespace
}  // namespace raymeld::test
