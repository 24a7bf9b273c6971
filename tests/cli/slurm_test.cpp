// Tests the array job of scripts/fuse-array.slurm on a Slurm of one node.
#include <fstream>

#include "sequence_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class Slurm : public SequenceTest {
 protected:
  void SetUp() override {
    SequenceTest::SetUp();
    environment_["RAYMELD"] = RAYMELD_PROGRAM;
    for (const char* name : {"ID", "MIN", "MAX", "COUNT"})
      environment_[fmt::format("SLURM_ARRAY_TASK_{}", name)] = std::nullopt;
  }

  static std::string script() { return source_path("scripts/fuse-array.slurm").string(); }

  // Runs the script as task `id` of --array=min-max with `count` tasks.
  ProcessResult run_task(int id, int min, int max, int count) {
    environment_["SLURM_ARRAY_TASK_ID"] = fmt::to_string(id);
    environment_["SLURM_ARRAY_TASK_MIN"] = fmt::to_string(min);
    environment_["SLURM_ARRAY_TASK_MAX"] = fmt::to_string(max);
    environment_["SLURM_ARRAY_TASK_COUNT"] = fmt::to_string(count);
    std::vector<std::string> arguments = fuse_frames("1-5", {"--dry-run", "--json"});
    arguments[0] = script();
    return run_process(arguments, {.directory = folder_.path(), .environment = environment_});
  }
};

TEST_F(Slurm, TasksShareTheFrames) {
  write_frames(1, 5);
  for (const int first : {0, 1, 7}) {
    EXPECT_EQ(Json::parse(run_task(first, first, first + 1, 2).out).at("frames"), Json({1, 3, 5}));
    EXPECT_EQ(Json::parse(run_task(first + 1, first, first + 1, 2).out).at("frames"), Json({2, 4}));
  }
  const ProcessResult gaps = run_task(1, 1, 4, 2);
  EXPECT_EQ(gaps.exit_status, 2);
  EXPECT_NE(gaps.err.find("gaps"), std::string::npos) << gaps.err;
  environment_["SLURM_ARRAY_TASK_ID"] = std::nullopt;
  const ProcessResult no_array = run_process({script()}, {.environment = environment_});
  EXPECT_EQ(no_array.exit_status, 2);
  EXPECT_NE(no_array.err.find("--array"), std::string::npos) << no_array.err;
}

// Three tasks fuse seven frames, one of which is not there at first.
TEST_F(Slurm, AnArrayJobFusesAllFramesAndTheSameAgainTheRest) {
  write_frames(1, 7);
  fs::rename(folder_ / low(5), folder_ / "late.exr");
  std::string submit = "sbatch --wait --array=1-3 '" + script() + "'";
  const std::vector<std::string> arguments = fuse_frames("1-7");
  for (size_t i = 1; i < arguments.size(); ++i) submit += " '" + arguments[i] + "'";
  write_file(folder_ / "farm.sh",
             submit + " --json; echo first $?; cat slurm-*.out > first.txt; rm slurm-*.out\n" +
                 "mv late.exr low.0005.exr; ls out.* > early.txt\n" + submit +
                 "; echo second $?; cat slurm-*.out > second.txt\n");
  const ProcessResult result = run_process({source_path("tests/slurm/with-slurm").string(), "sh", "farm.sh"},
                                           {.directory = folder_.path(), .environment = environment_});
  if (result.exit_status == 77) GTEST_SKIP() << result.err;
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_NE(result.out.find("first 2\n"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("second 0\n"), std::string::npos) << result.out;
  EXPECT_EQ(read_file(folder_ / "early.txt").find(out(5)), std::string::npos);
  const std::string first = read_file(folder_ / "first.txt"), second = read_file(folder_ / "second.txt");
  EXPECT_NE(first.find("frame 5: cannot read 'low.0005.exr'"), std::string::npos) << first;
  for (const char* text : {"2 frames: 1 fused, 1 skipped (2)", "3 frames: 0 fused, 3 skipped (1,4,7)",
                           "2 frames: 0 fused, 2 skipped (3,6)"})
    EXPECT_NE(second.find(text), std::string::npos) << "'" << text << "' in: " << second;
  for (int frame = 1; frame <= 7; ++frame) {
    ASSERT_TRUE(is_there(out(frame))) << frame << first << second;
    EXPECT_EQ(read_file(folder_ / out(frame)), fused_alone(frame)) << frame;
  }
}

}  // namespace
}  // namespace raymeld::test
