// Tests the phases that fuse reports, and the first run, which compiles kernels.
#include "cli_fixture.h"

namespace raymeld::test {
namespace {

class CliStart : public Cli {
 protected:
  // Starts with nothing that the driver or the program has compiled before.
  void SetUp() override {
    Cli::SetUp();
    environment_["MESA_SHADER_CACHE_DIR"] = (folder_ / "cache" / "driver").string();
  }
};

TEST_F(CliStart, PhasesAreReported) {
  const nlohmann::json report = run_json(fuse({"--json"}));
  double sum = 0;
  for (const char* phase : {"open", "device", "read", "prepare", "fuse", "write"}) {
    SCOPED_TRACE(phase);
    const double time_ms = report.at("phases_ms").at(phase);
    EXPECT_GT(time_ms, 0);
    sum += time_ms;
  }
  EXPECT_LE(sum, report.at("total_ms").get<double>());
  EXPECT_EQ(report.at("phases_ms").size(), 6u);
  const ProcessResult profile = run(fuse({"--profile"}));
  ASSERT_EQ(profile.exit_status, 0) << profile.err;
  for (const char* phase : {"phase ", "open ", "device ", "read ", "prepare ", "fuse ", "write "})
    EXPECT_NE(profile.out.find(phase), std::string::npos) << phase << " in " << profile.out;
}

TEST_F(CliStart, TheFirstRunSaysThatItCompilesAndDoesNotCountIt) {
  const nlohmann::json first = run_json(fuse({"--json"}));
  EXPECT_LT(first.at("device_ms").get<double>(), first.at("phases_ms").at("prepare").get<double>());
  EXPECT_LT(first.at("fuse_ms").get<double>(), first.at("phases_ms").at("prepare").get<double>());
  std::filesystem::remove_all(folder_ / "cache");
  const std::string text = "compiling kernels for ";
  const ProcessResult again = run(fuse());
  EXPECT_NE(again.err.find(text), std::string::npos) << again.err;
  const ProcessResult warm = run(fuse());
  EXPECT_EQ(warm.err.find(text), std::string::npos) << warm.err;
}

}  // namespace
}  // namespace raymeld::test
