// Stops a sequence in its middle with kill -9, and runs the same command again.
#include <csignal>
#include <random>

#include "sequence_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class SequenceKill : public SequenceTest {
 protected:
  static constexpr int kFrames = 6;

  static std::vector<std::string> outputs_of(int frame) {
    return {fmt::format("view.{:04}.png", frame), out(frame)};
  }
  static std::vector<std::string> command() {
    return fuse_frames(fmt::format("1-{}", kFrames), {"--preview", "view.####.png", "--resume"});
  }
  static std::vector<std::string> command_json() {
    std::vector<std::string> arguments = command();
    arguments.push_back("--json");
    return arguments;
  }
};

TEST_F(SequenceKill, TheSameCommandGoesOn) {
  for (int frame = 1; frame <= kFrames; ++frame) write_frame(frame, 32, 24);
  const std::set<std::string> inputs = files();
  ASSERT_EQ(run(command()).exit_status, 0);
  std::map<std::string, std::string> expected;
  for (const std::string& name : files())
    if (!inputs.contains(name)) expected[name] = read_file(folder_ / name);
  ASSERT_EQ(expected.size(), size_t(2 * kFrames));

  constexpr unsigned kSeed = 1;
  std::mt19937 random(kSeed);
  const int kills = full_extent() ? 12 : 4;
  int killed = 0, done_before = 0;
  for (int i = 0; i < kills; ++i) {
    SCOPED_TRACE(fmt::format("kill {} of seed {}", i, kSeed));
    for (const auto& [name, content] : expected) fs::remove(folder_ / name);
    std::vector<std::string> arguments = command();
    arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
    const ProcessResult result = run_process(
        arguments,
        {.directory = folder_.path(),
         .environment = environment_,
         .signal = SIGKILL,
         .signal_after = fmt::format("frame {}: wrote", 1 + i % (kFrames - 1)),
         .signal_delay = std::chrono::microseconds(std::uniform_int_distribution(0, 30'000)(random))});
    killed += result.signal == SIGKILL;

    Json done = Json::array();
    std::map<std::string, fs::file_time_type> times;
    for (int frame = 1; frame <= kFrames; ++frame) {
      bool all = true;
      for (const std::string& name : outputs_of(frame)) {
        if (is_there(name)) {
          EXPECT_EQ(read_file(folder_ / name), expected[name]) << name;
          times[name] = fs::last_write_time(folder_ / name);
        }
        all &= is_there(name);
      }
      if (all) done.push_back(frame);
    }
    done_before += int(done.size());
    const Json resumed = run_json(command_json());
    EXPECT_EQ(resumed.at("skipped"), done);
    EXPECT_EQ(resumed.at("fused").size(), kFrames - done.size());
    for (const auto& [name, content] : expected) EXPECT_EQ(read_file(folder_ / name), content) << name;
    for (const Json& frame : done)
      for (const std::string& name : outputs_of(frame))
        EXPECT_EQ(fs::last_write_time(folder_ / name), times[name]);
  }
  EXPECT_GT(killed, 0);
  EXPECT_GT(done_before, 0);
  fmt::print("seed {}: {} of {} killed, {} frames not done again\n", kSeed, killed, kills, done_before);
}

}  // namespace
}  // namespace raymeld::test
