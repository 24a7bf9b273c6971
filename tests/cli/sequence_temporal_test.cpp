// Joins the frames of sequences in time, with --temporal.
#include <fstream>

#include "golden.h"
#include "sequence_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

const std::vector<std::string> kMovedNames = {"R",        "G",        "B",        "normal.X",
                                              "normal.Y", "normal.Z", "albedo.R", "albedo.G",
                                              "albedo.B", "motion.X", "motion.Y"};

class SequenceTemporal : public SequenceTest {
 protected:
  static constexpr int kWidth = 160, kHeight = 32;

  // Writes a frame with noise of its own. Frames of one shot show the same surfaces.
  void write(int frame, int shot = 1, float motion = 0,
             const std::vector<std::string>& names = kMovedNames) const {
    write_image(folder_ / low(frame), kColorNames, random_image(kColorNames, kWidth, kHeight, 7));
    Image high = random_image(names, 2 * kWidth, 2 * kHeight, uint64_t(100 + shot));
    const Image noise = random_image(kColorNames, 2 * kWidth, 2 * kHeight, uint64_t(200 + frame));
    std::ranges::copy(noise.data, high.data.begin());
    for (size_t i = 0; shot > 1 && i < 3 * high.plane_size(); ++i) high.plane(6)[i] /= 2;  // a darker albedo
    if (high.channels == int(kMovedNames.size())) std::fill_n(high.plane(9), 2 * high.plane_size(), motion);
    write_image(folder_ / high_name(frame), names, high);
  }
  void write_shot(int first, int last, int shot) const {
    for (int frame = first; frame <= last; ++frame) write(frame, shot);
  }
  static std::string high_name(int frame) { return SequenceTest::high(frame); }

  static std::vector<std::string> join(const std::string& frames, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {
        "fuse",         "--lrhs",        "low.####.exr",
        "--hrls",       "high.####.exr", "-o",
        "out.####.exr", "--model",       golden_model_path("pyramid-x2").string(),
        "--temporal",   "--frames",      frames};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  // Runs the command and returns the hashes of its frames' files, which it removes.
  std::map<int, size_t> images(const std::string& frames, const std::vector<std::string>& more = {},
                               int exit_status = 0) const {
    const ProcessResult result = run(join(frames, more));
    EXPECT_EQ(result.exit_status, exit_status) << result.err;
    std::map<int, size_t> all;
    for (int frame = 1; frame < 20; ++frame) {
      if (!is_there(out(frame))) continue;
      all[frame] = std::hash<std::string>()(read_file(folder_ / out(frame)));
      fs::remove(folder_ / out(frame));
    }
    return all;
  }
};

TEST_F(SequenceTemporal, AFrameHasTheSameBitsWhoeverComputesIt) {
  write_shot(1, 7, 1);
  const auto whole = images("1-7");
  ASSERT_EQ(whole.size(), 7u);
  EXPECT_EQ(images("1").at(1), whole.at(1));
  EXPECT_NE(images("4").at(4), whole.at(4));  // it begins a sequence
  std::map<int, size_t> parts;
  for (const char* shard : {"1/3", "2/3", "3/3"}) {
    for (const auto& [frame, image] : images("1-7", {"--shard", shard}))
      EXPECT_TRUE(parts.emplace(frame, image).second) << frame;
  }
  EXPECT_EQ(parts, whole);
  // Direct kernels give the same bits in any tiles.
  const std::string direct = "--kernels=direct";
  const Json plan = run_json(join("1", {"--dry-run", "--json", direct})).at("first");
  const std::string tiled = fmt::format("--max-memory={}", plan.at("peak_bytes").get<uint64_t>() >> 20);
  EXPECT_GT(run_json(join("1", {"--json", tiled, direct})).at("frames").at(0).at("tiles"), 1);
  EXPECT_EQ(images("1-4", {tiled, direct}), images("1-4", {direct}));
}

TEST_F(SequenceTemporal, ResumingGoesOnWithTheFramesBefore) {
  write_shot(1, 5, 1);
  ASSERT_EQ(run(join("1-5")).exit_status, 0);
  const std::string last = read_file(folder_ / out(5));
  fs::remove(folder_ / out(5));
  const auto first_time = fs::last_write_time(folder_ / out(1));
  const Json resumed = run_json(join("1-5", {"--resume", "--json"}));
  EXPECT_EQ(resumed.at("fused"), Json({5}));
  EXPECT_EQ(resumed.at("lead-in"), Json({1, 2, 3, 4}));
  EXPECT_EQ(read_file(folder_ / out(5)), last);
  EXPECT_EQ(fs::last_write_time(folder_ / out(1)), first_time);
  // What changes one frame changes those that are joined with it.
  fs::last_write_time(folder_ / high_name(3),
                      fs::last_write_time(folder_ / out(5)) + std::chrono::seconds(1));
  const Json plan = run_json(join("1-5", {"--resume", "--dry-run", "--json"}));
  EXPECT_EQ(plan.at("frames"), Json({3, 4, 5}));
  EXPECT_EQ(plan.at("lead-in"), Json({1, 2}));
  const Json cut = run_json(join("1-5", {"--resume", "--reset-at", "4", "--dry-run", "--json"}));
  EXPECT_EQ(cut.at("frames"), Json({3}));
}

TEST_F(SequenceTemporal, AShotStartsAnew) {
  write_shot(1, 3, 1);
  write_shot(4, 6, 2);
  write_shot(8, 9, 2);
  const Json joined = run_json(join("1-6,8-9", {"--json"}));
  std::vector<int> starts;
  for (const Json& frame : joined.at("frames"))
    if (frame.at("starts_anew")) starts.push_back(frame.at("frame"));
  EXPECT_EQ(starts, (std::vector<int>{1, 4, 8}));  // the first, a cut, and one without the frame before
  const auto whole = images("1-6,8-9");
  EXPECT_EQ(images("4-6").at(6), whole.at(6));
  EXPECT_EQ(images("8-9").at(9), whole.at(9));
  EXPECT_EQ(images("1-3", {"--reset-at", "3"}).at(3), images("3").at(3));
  EXPECT_NE(images("3").at(3), whole.at(3));
  // A frame that fails is as one that is missing, also where it leads in.
  std::ofstream(folder_ / high_name(5)) << "no image";
  const auto failed = images("4-6", {}, 2);
  EXPECT_EQ(failed.at(6), images("6").at(6));
  EXPECT_EQ(images("4-6", {"--shard", "3/3"}, 2), (std::map<int, size_t>{{6, failed.at(6)}}));
}

TEST_F(SequenceTemporal, AlphaIsJoinedToo) {
  std::vector<std::string> names = kMovedNames;
  names.push_back("A");
  for (const int frame : {1, 2, 3}) {
    write(frame);
    Image high = read(high_name(frame), kMovedNames);
    const Image alpha = random_image({"A"}, high.width, high.height, uint64_t(300 + frame));
    high.data.insert(high.data.end(), alpha.data.begin(), alpha.data.end());
    ++high.channels;
    write_image(folder_ / high_name(frame), names, high);
    write_image(folder_ / low(frame), kAlphaNames, random_image(kAlphaNames, kWidth, kHeight, 7));
  }
  const auto alphas = [&](const std::string& frames, const std::vector<std::string>& more = {}) {
    const ProcessResult result = run(join(frames, more));
    EXPECT_EQ(result.exit_status, 0) << result.err;
    return read(out(3), {"A"}).data;
  };
  const std::vector<float> whole = alphas("1-3");
  EXPECT_EQ(alphas("1-3", {"--shard", "3/3"}), whole);
  EXPECT_NE(alphas("3"), whole);
}

TEST_F(SequenceTemporal, OneRenderAloneIsJoined) {
  write_shot(1, 3, 1);
  const auto denoised = [&](const std::string& frames, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"denoise",
                                          "--hrls",
                                          "high.####.exr",
                                          "-o",
                                          "out.####.exr",
                                          "--model",
                                          golden_model_path("pyramid-x1").string(),
                                          "--temporal",
                                          "--frames",
                                          frames};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 0) << result.err;
    return read_file(folder_ / out(3));
  };
  const std::string whole = denoised("1-3");
  EXPECT_TRUE(denoised("1-3", {"--shard", "3/3"}) == whole);
  EXPECT_FALSE(denoised("3") == whole);
}

TEST_F(SequenceTemporal, MotionIsFoundByNameOrNamed) {
  for (const int frame : {1, 2}) write(frame, 1, 1);
  const size_t named = images("1-2").at(2);
  const size_t still = images("1-2", {"--still"}).at(2);
  EXPECT_NE(named, still);
  EXPECT_EQ(images("1-2", {"--map", "motion=motion.Y,motion.X"}).at(2), named);
  EXPECT_EQ(images("1-2", {"--map", "motion-factors=0,0"}).at(2), still);
  // Cycles's vectors have Y upwards.
  std::vector<std::string> cycles = kMovedNames;
  for (std::string& name : cycles) {
    if (const size_t at = name.find("motion"); at == 0) name.replace(0, 6, "ViewLayer.Vector");
    if (name.size() == 1) name = "ViewLayer.Combined." + name;
    if (const size_t at = name.find("normal"); at == 0) name.replace(0, 6, "ViewLayer.Denoising Normal");
    if (const size_t at = name.find("albedo"); at == 0) name.replace(0, 6, "ViewLayer.Denoising Albedo");
  }
  for (const int frame : {1, 2}) write(frame, 1, 1, cycles);
  EXPECT_EQ(images("1-2", {"--map", "motion-factors=1,1"}).at(2), named);
  EXPECT_NE(images("1-2").at(2), named);
  EXPECT_EQ(images("1-2", {"--map", "motion=ViewLayer.Vector"}).at(2), named);
}

TEST_F(SequenceTemporal, DepthIsFoundByNameOrNamed) {
  std::vector<std::string> names = kMovedNames;
  const size_t depth = names.size();
  names.push_back("depth.Z");
  const auto write_depths = [&](float first, float second) {
    for (const int frame : {1, 2}) {
      write(frame);
      Image high = read(high_name(frame), kMovedNames);
      Image deep(high.width, high.height, int(names.size()));
      std::ranges::copy(high.data, deep.data.begin());
      std::fill_n(deep.plane(int(depth)), deep.plane_size(), frame == 1 ? first : second);
      write_image(folder_ / high_name(frame), names, deep);
    }
  };
  write_depths(2, 2);
  const size_t same = images("1-2").at(2);
  write_depths(2, 4);
  EXPECT_NE(images("1-2").at(2), same);
  EXPECT_EQ(images("1-2", {"--still"}).at(2), same) << "nothing moves, so that no depth matters";
  EXPECT_EQ(images("1-2", {"--map", "depth=motion.X"}).at(2), same) << "0 is no depth";
  expect_error(join("1-2", {"--map", "depth=nope"}), {"cannot map depth", "no channel 'nope'"});
}

TEST_F(SequenceTemporal, WhatCannotBeJoinedIsRefused) {
  for (const int frame : {1, 2}) write(frame, 1, 0, kLayeredNames);
  expect_error(join("1-2"), {"high.0001.exr", "no motion vectors", "looked for motion", "--still"});
  expect_error(join("1-2", {"--still", "--map", "motion-factors=1,1"}), {"no motion vectors"});
  write_shot(1, 2, 1);
  expect_error(join("1-2", {"--map", "motion=albedo.R"}), {"cannot map motion to 'albedo.R'"});
  expect_error(join("1-2", {"--map", "motion-factors=1"}), {"'motion-factors=1'", "two factors"});
  expect_error(join("2,1"), {"ascending order", "2 before 1"});
  expect_error(join("1-2", {"--reset-at", "3"}), {"--reset-at 3", "no such frame"});
  expect_error(join("1-2", {"--map", "motion=motion.X,motion.Z"}), {"no channel 'motion.Z'"});
  expect_error(join("1-2", {"--window", "0,0,8,8"}), {"--temporal", "--window"});
  expect_error(join("1-2", {"--skip-unchanged"}), {"--temporal", "--skip-unchanged"});
  expect_error(join("1-2", {"--profile"}), {"--temporal", "--profile"});
  expect_error(join("1-2", {"--overflow", "redo"}), {"--temporal", "--overflow redo"});
  expect_error(join("1-2", {"--lrhs-sampling", "nearest"}), {"ordinary small render"});
  expect_error(fuse({"--temporal"}), {"--frames"});
  expect_error(fuse_frames("1-2", {"--still"}), {"--temporal"});
  const ProcessResult unfit =
      expect_error(fuse_frames("1-2", {"--temporal"}), {"keeps no history", "pyramid"});
  EXPECT_EQ(unfit.err.find("frame 1"), std::string::npos) << unfit.err;  // it is said once
}

}  // namespace
}  // namespace raymeld::test
