#include "support.h"

#include <gtest/gtest.h>

#include <csignal>
#include <set>
#include <system_error>

namespace raymeld::test {
namespace {

TEST(RunProcess, StatusAndBothStreams) {
  const ProcessResult result = run_process({"sh", "-c", "cat; printf out; printf err >&2; exit 3"});
  EXPECT_EQ(result.exit_status, 3);
  EXPECT_EQ(result.signal, 0);
  EXPECT_EQ(result.out, "out");
  EXPECT_EQ(result.err, "err");
}

TEST(RunProcess, MoreThanAPipeHolds) {
  const ProcessResult result =
      run_process({"sh", "-c", "head -c 300000 /dev/zero >&2; head -c 200000 /dev/zero"});
  EXPECT_EQ(result.err.size(), 300000u);
  EXPECT_EQ(result.out.size(), 200000u);
}

TEST(RunProcess, DirectoryAndEnvironment) {
  const TemporaryDirectory directory;
  ProcessOptions options{.directory = directory.path(), .environment = {{"RAYMELD_A", "1"}, {"HOME", {}}}};
  const ProcessResult result = run_process({"sh", "-c", "pwd; echo $RAYMELD_A${HOME-unset}"}, options);
  EXPECT_EQ(result.out, directory.path().string() + "\n1unset\n");
}

TEST(RunProcess, SignalAfterText) {
  const std::string wait = "echo ready >&2; while :; do sleep 0.01; done";
  const ProcessOptions options{.signal = SIGINT, .signal_after = "ready"};
  EXPECT_EQ(run_process({"sh", "-c", wait}, options).signal, SIGINT);
  EXPECT_EQ(run_process({"sh", "-c", "trap 'exit 7' INT; " + wait}, options).exit_status, 7);
}

TEST(RunProcess, WhatCannotStart) { EXPECT_THROW(run_process({"/nonexistent/program"}), std::system_error); }

TEST(TemporaryDirectory, GoesWithItsContent) {
  std::filesystem::path path;
  {
    const TemporaryDirectory directory;
    path = directory.path();
    write_file(directory / "file", "content");
    EXPECT_EQ(read_file(directory / "file"), "content");
  }
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_THROW(read_file(path / "file"), std::runtime_error);
}

TEST(RandomPlanes, SameSeedSameValues) {
  const std::vector<double> a = random_planes(2, 5, 7, Fill::kUniform, 1).data;
  EXPECT_EQ(a, random_planes(2, 5, 7, Fill::kUniform, 1).data);
  EXPECT_NE(a, random_planes(2, 5, 7, Fill::kUniform, 2).data);
  EXPECT_EQ(std::set<double>(a.begin(), a.end()).size(), a.size());
}

TEST(RandomPlanes, IntegersAreSmall) {
  const std::vector<double> values = random_planes(1, 20, 20, Fill::kIntegers, 3).data;
  EXPECT_EQ(std::set<double>(values.begin(), values.end()), (std::set<double>{-2, -1, 0, 1, 2}));
}

}  // namespace
}  // namespace raymeld::test
