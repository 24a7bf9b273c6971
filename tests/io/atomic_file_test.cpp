#include "platform/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <random>
#include <set>
#include <thread>

#include "error_of.h"
#include "names_on_disk.h"
#include "support.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

// Tests files without a name until commit(), and files with a temporary one, as other file systems need.
class AtomicFileTest : public testing::TestWithParam<bool> {
 protected:
  void write(const std::string& content) {
    AtomicFile file(folder_ / "a", GetParam());
    file.write(content.data(), content.size());
    file.commit();
  }

  TemporaryDirectory folder_;
};

TEST_P(AtomicFileTest, AppearsAtCommit) {
  for (const std::string content : {"first", "second"}) {
    const std::set<std::string> before = names_in(folder_.path());
    AtomicFile file(folder_ / "a", GetParam());
    file.write(content.data(), content.size());
    file.finish();
    const std::set<std::string> during = names_in(folder_.path());
    EXPECT_EQ(during.size(), before.size() + (GetParam() ? 0 : 1));
    EXPECT_TRUE(before.empty() || read_file(folder_ / "a") == "first");
    file.commit();
    EXPECT_EQ(names_in(folder_.path()), std::set<std::string>{"a"});
    EXPECT_EQ(read_file(folder_ / "a"), content);
  }
  EXPECT_EQ(fs::hard_link_count(folder_ / "a"), 1u);
}

TEST_P(AtomicFileTest, WithoutCommitNothingIsLeft) {
  write("older");
  { AtomicFile(folder_ / "a", GetParam()).write("newer", 5); }
  EXPECT_EQ(names_in(folder_.path()), std::set<std::string>{"a"});
  EXPECT_EQ(read_file(folder_ / "a"), "older");
}

// Two processes may write one name at once: the last commit wins, and both files are whole.
TEST_P(AtomicFileTest, TwoOfOneNameKeepApart) {
  AtomicFile first(folder_ / "a", GetParam()), second(folder_ / "a", GetParam());
  first.write("first", 5);
  second.write("second", 6);
  second.commit();
  EXPECT_EQ(read_file(folder_ / "a"), "second");
  first.commit();
  EXPECT_EQ(read_file(folder_ / "a"), "first");
  EXPECT_EQ(names_in(folder_.path()), std::set<std::string>{"a"});
}

// A child writes files of one letter each over and over, and is killed at any point.
TEST_P(AtomicFileTest, AKillLeavesAWholeFileOrNone) {
  constexpr size_t kBytes = 300'000;
  std::mt19937 random(1);
  unsigned most_us = 8000;  // the longest wait before the kill; grows where no file appears by then
  int appeared = 0, left_behind = 0;
  for (int kill_number = 0; kill_number < 60; ++kill_number) {
    if (kill_number % 2 == 0) fs::remove(folder_ / "a");
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    for (char letter = 'a'; child == 0; letter = letter == 'z' ? 'a' : char(letter + 1))
      write(std::string(kBytes, letter));
    std::this_thread::sleep_for(std::chrono::microseconds(random() % most_us));
    kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status)) << "it ended by itself";
    if (!fs::exists(folder_ / "a")) most_us = std::min(2 * most_us, 1'000'000u);
    if (fs::exists(folder_ / "a")) {
      const std::string content = read_file(folder_ / "a");
      ASSERT_EQ(content.size(), kBytes);
      EXPECT_EQ(size_t(std::ranges::count(content, content[0])), kBytes);
      appeared += kill_number % 2 == 0;
    }
    for (const std::string& name : names_in(folder_.path())) {
      if (name == "a") continue;
      EXPECT_TRUE(name.starts_with(".raymeld-") && name.ends_with(".tmp")) << name;
      fs::remove(folder_ / name);
      ++left_behind;
    }
  }
  EXPECT_GT(appeared, 0);
  RecordProperty("appeared", appeared);
  RecordProperty("left_behind", left_behind);
  write("after all that");
  EXPECT_EQ(read_file(folder_ / "a"), "after all that");
}

// Runs the test above in a process of its own, with a log between it and the disk.
TEST(AtomicFile, IsOnTheDiskAfterCommit) {
  const TemporaryDirectory folder;
  const std::filesystem::path log = folder / "log";
  const ProcessResult result =
      run_process({"/proc/self/exe", "--gtest_filter=*AtomicFileTest.AppearsAtCommit*"},
                  {.environment = {{"LD_PRELOAD", RAYMELD_SYNC_LOG_LIBRARY},
                                   {"RAYMELD_SYNC_LOG", log.string()},
                                   {"ASAN_OPTIONS", "detect_leaks=0:verify_asan_link_order=0"},
                                   {"GTEST_TOTAL_SHARDS", std::nullopt}}});
  ASSERT_EQ(result.exit_status, 0) << result.out;
  EXPECT_TRUE(names_on_disk(read_file(log)).contains("a"));
}

INSTANTIATE_TEST_SUITE_P(Files, AtomicFileTest, testing::Bool(),
                         [](const auto& info) { return info.param ? "Unnamed" : "Named"; });

}  // namespace
}  // namespace raymeld::test
