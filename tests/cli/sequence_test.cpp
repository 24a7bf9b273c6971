// Tests sequences: every frame comes out as it would alone, and a bad frame affects no other.
#include <csignal>
#include <fstream>

#include "io/safetensors.h"
#include "sequence_fixture.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class Sequence : public SequenceTest {
 protected:
  // Returns the frames that a run would fuse.
  Json planned(const std::string& frames, std::vector<std::string> more = {}) const {
    more.insert(more.end(), {"--dry-run", "--json"});
    return run_json(fuse_frames(frames, more)).at("frames");
  }

  // Expects a run to end with an error before it has fused anything.
  void expect_error(const std::vector<std::string>& arguments, const std::vector<std::string>& texts) const {
    const ProcessResult result = Cli::expect_error(arguments, texts);
    EXPECT_EQ(result.err.find("frame 1: "), std::string::npos) << result.err;
  }

  void expect_fused_as_alone(int frame) const {
    ASSERT_TRUE(is_there(out(frame))) << frame;
    EXPECT_EQ(read_file(folder_ / out(frame)), fused_alone(frame)) << frame;
  }

  void set_older(const std::string& name, const std::string& than, std::chrono::milliseconds by) const {
    fs::last_write_time(folder_ / name, fs::last_write_time(folder_ / than) - by);
  }
};

// Writes all kinds of outputs, for frames of two sizes.
TEST_F(Sequence, FramesAreWhatEachWouldBeAlone) {
  write_frames(1, 4);
  write_frame(3, 16, 12);
  write_frame(5, 16, 12);
  const auto outputs = [](const std::string& frame) {
    return std::vector<std::string>{"--preview",
                                    "view." + frame + ".png",
                                    "--preview-before-after",
                                    "both." + frame + ".png",
                                    "--dump",
                                    "layers." + frame,
                                    "--reference",
                                    "high." + frame + ".exr",
                                    "--keep-layers"};
  };
  const ProcessResult result = run(fuse_frames("1-5", outputs("####")));
  ASSERT_EQ(result.exit_status, 0) << result.err;
  EXPECT_NE(result.err.find("5 frames: 5 fused; "), std::string::npos) << result.err;
  std::string tables;
  for (int frame = 1; frame <= 5; ++frame) {
    const std::string number = fmt::format("{:04}", frame);
    const std::vector<std::string> names = {"out." + number + ".exr", "view." + number + ".png",
                                            "both." + number + ".png", "layers." + number + "/decode.npy",
                                            "layers." + number + "/lrhs.npy"};
    std::vector<std::string> in_sequence;
    for (const std::string& name : names) in_sequence.push_back(read_file(folder_ / name));
    std::vector<std::string> alone = {"fuse", "--lrhs",   low(frame), "--hrls",    high(frame),
                                      "-o",   out(frame), "--model",  tiny_model()};
    const std::vector<std::string> more = outputs(number);
    alone.insert(alone.end(), more.begin(), more.end());
    const ProcessResult single = run(alone);
    ASSERT_EQ(single.exit_status, 0) << single.err;
    for (size_t i = 0; i < names.size(); ++i)
      EXPECT_EQ(in_sequence[i], read_file(folder_ / names[i])) << names[i];
    tables += fmt::format("frame {}\n{}", frame, single.out);
  }
  EXPECT_EQ(result.out, tables);
}

TEST_F(Sequence, ModelsAndSamplingMayChangeBetweenFrames) {
  fs::create_directory(folder_ / "models");
  environment_["RAYMELD_MODELS"] = (folder_ / "models").string();
  for (const auto& [golden, name] :
       {std::pair("guided-x2", "x2-fast"), std::pair("guided-x4", "x4-balanced")}) {
    fs::copy_file(source_path(fmt::format("tests/golden/{}.safetensors", golden)),
                  folder_ / fmt::format("models/{}.safetensors", name));
  }
  write_frames(1, 4);
  ASSERT_EQ(run({"degrade", high(2), "--scale", "2", "-o", low(2)}).exit_status, 0);
  const auto fuse = [&](const std::string& frame, const std::string& output, std::vector<std::string> more) {
    more.insert(more.begin(), {"fuse", "--lrhs", "low." + frame + ".exr", "--hrls", "high." + frame + ".exr",
                               "-o", output, "--json"});
    return run_json(more);
  };
  const Json frames = fuse("####", "out.####.exr", {"--frames", "1-4"}).at("frames");
  for (const Json& frame : frames) {
    const std::string number = fmt::format("{:04}", frame.at("frame").get<int>());
    const Json alone = fuse(number, "alone.exr", {});
    for (const char* key : {"model", "scale", "lrhs_sampling", "peak_bytes", "input_exposure"})
      EXPECT_EQ(frame.at(key), alone.at(key)) << number << " " << key;
    EXPECT_EQ(read_file(folder_ / ("out." + number + ".exr")), read_file(folder_ / "alone.exr")) << number;
  }
  EXPECT_EQ(frames.at(1).at("scale"), 2);
  EXPECT_EQ(frames.at(2).at("scale"), 4);
}

TEST_F(Sequence, FramesComeOnceAndInTheOrderInWhichTheyAreNamed) {
  write_frames(0, 9);
  EXPECT_EQ(planned("7"), Json({7}));
  EXPECT_EQ(planned("1-4"), Json({1, 2, 3, 4}));
  EXPECT_EQ(planned("1-9x4"), Json({1, 5, 9}));
  EXPECT_EQ(planned("1-8x4"), Json({1, 5}));
  EXPECT_EQ(planned("9,0-2,1-5x2"), Json({9, 0, 1, 2, 3, 5}));
  EXPECT_EQ(planned("0001-0003"), Json({1, 2, 3}));
  EXPECT_EQ(planned("8,999999999"), Json({8, 999999999}));
  for (const char* bad :
       {"", " 1", "a", "1-", "1x2", "1-2x", "1-2-3", "1,,2", "1,", "1-1000000000", "0x10", "+1"})
    expect_error(fuse_frames(bad), {"--frames", fmt::format("'{}'", bad), "nor a range"});
  expect_error(fuse_frames("1,5-3"), {"--frames", "'5-3' ends before it begins"});
  expect_error(fuse_frames("1-3x0"), {"--frames", "'1-3x0' has a step of 0"});
  expect_error(fuse_frames("0-1000000"), {"--frames", "more than 1000000"});
  for (const char* negative : {"--frames=-5", "--frames=-5--1", "--frames=1--3"}) {
    std::vector<std::string> arguments = fuse_frames("");
    arguments.resize(arguments.size() - 2);
    arguments.push_back(negative);
    expect_error(arguments, {"--frames", "from 0 to 999999999"});
  }
}

TEST_F(Sequence, TheLastRunOfAFileNameIsTheNumber) {
  fs::create_directory(folder_ / "C##");
  const auto missing = [&](const std::string& lrhs, const std::string& frame) {
    return run({"fuse", "--lrhs", lrhs, "--hrls", "high.exr", "-o", "C##/o#.exr", "--model", tiny_model(),
                "--frames", frame})
        .err;
  };
  struct Case {
    const char *pattern, *frame, *path;
  };
  const Case cases[] = {
      {.pattern = "a.####.exr", .frame = "7", .path = "'a.0007.exr'"},
      {.pattern = "a.#.exr", .frame = "12", .path = "'a.12.exr'"},
      {.pattern = "a.##.exr", .frame = "12345", .path = "'a.12345.exr'"},
      {.pattern = "C##/take#2.###", .frame = "0", .path = "'C##/take#2.000'"},
      {.pattern = "./##", .frame = "3", .path = "'./03'"},
  };
  for (const auto& [pattern, frame, path] : cases) {
    const std::string err = missing(pattern, frame);
    EXPECT_NE(err.find(fmt::format("frame {}: cannot read {}", frame, path)), std::string::npos) << err;
  }
}

TEST_F(Sequence, PatternsAndFramesBelongTogether) {
  write_frames(1, 2);
  expect_error(fuse({"--preview", "a.##.png"}), {"--preview 'a.##.png'", "--frames"});
  expect_error(fuse({"--resume"}), {"--resume", "--frames"});
  expect_error(fuse({"--shard", "1/2"}), {"--shard", "--frames"});
  expect_error(fuse({"--frames", "1-2"}), {"--lrhs 'low.exr'", "--hrls 'high.exr'"});
  expect_error(fuse_frames("1-2", {"--preview", "a.png"}), {"--preview 'a.png'", "all frames"});
  expect_error(fuse_frames("1-2", {"--dump", "####/layers"}), {"--dump '####/layers'", "all frames"});
  expect_error(fuse_frames("1-2", {"--preview", "./a.####.png", "--preview-before-after", "a.####.png"}),
               {"a.0001.png", "two outputs"});
  const auto written = [&](const std::string& frames, const std::string& output) {
    std::vector<std::string> arguments = fuse_frames(frames);
    arguments[6] = output;
    return arguments;
  };
  expect_error(written("1-2", "../" + folder_.path().filename().string() + "/high.####.exr"),
               {"high.0001.exr", "input"});
  // An output may not be the input of another frame.
  expect_error(written("1-20001x10000", "low.1####.exr"), {"low.10001.exr", "input"});
  // One LRHS may serve all frames.
  const ProcessResult result = run({"fuse", "--lrhs", low(1), "--hrls", "high.####.exr", "-o", "out.####.exr",
                                    "--model", tiny_model(), "--frames", "1-2"});
  EXPECT_EQ(result.exit_status, 0) << result.err;
  expect_fused_as_alone(1);
}

TEST_F(Sequence, WhatIsWrongWithAllFramesIsSaidOnce) {
  write_frames(1, 3);
  std::vector<std::string> arguments = fuse_frames("1-3");
  const auto with = [&](size_t at, const std::string& value) {
    std::vector<std::string> changed = arguments;
    changed[at] = value;
    return changed;
  };
  expect_error(with(6, "none/out.####.exr"), {"none/out.0001.exr", "no folder"});
  expect_error(with(8, "none.safetensors"), {"none.safetensors", "no such file"});
  expect_error(fuse_frames("1-3", {"--dump", "none/####"}), {"none/0001", "no folder"});
  expect_error(fuse_frames("1-3", {"--device", "99"}), {"99"});
  expect_error(fuse_frames("1-3", {"--map", "shine=R"}), {"shine", "albedo"});
}

TEST_F(Sequence, BadFramesFailAlone) {
  write_frames(1, 6);
  fs::remove(folder_ / low(2));
  const std::string whole = read_file(folder_ / high(3));
  write_file(folder_ / high(3), whole.substr(0, whole.size() / 2));
  write_image(folder_ / low(4), kColorNames, random_image(kColorNames, 9, 6, 1));
  fs::create_directory(folder_ / out(5));
  const std::set<std::string> before = files();
  const ProcessResult result = run(fuse_frames("1-6", {"--json"}));
  EXPECT_EQ(result.exit_status, 2);
  for (const char* text :
       {"raymeld: error: frame 2: cannot read 'low.0002.exr'", "frame 3: cannot read 'high.0003.exr'",
        "frame 4: the sizes do not fit", "frame 5: cannot write 'out.0005.exr'",
        "raymeld: error: 6 frames: 2 fused, 4 failed (2-5); "})
    EXPECT_NE(result.err.find(text), std::string::npos) << "'" << text << "' in: " << result.err;
  const Json json = Json::parse(result.out);
  EXPECT_EQ(json.at("error").get<std::string>().find("6 frames: 2 fused, 4 failed (2-5); "), 0u);
  EXPECT_EQ(json.at("fused"), Json({1, 6}));
  EXPECT_EQ(json.at("failed"), Json({2, 3, 4, 5}));
  EXPECT_EQ(json.at("skipped"), Json::array());
  EXPECT_EQ(json.at("unfinished"), Json::array());
  ASSERT_EQ(json.at("frames").size(), 6u);
  double sum_ms = 0;
  for (int frame = 1; frame <= 6; ++frame) {
    const Json& entry = json.at("frames").at(size_t(frame - 1));
    EXPECT_EQ(entry.at("frame"), frame);
    const bool good = frame == 1 || frame == 6;
    EXPECT_EQ(entry.at("status"), good ? "fused" : "failed");
    EXPECT_EQ(entry.contains("error"), !good);
    if (good) sum_ms += entry.at("device_ms").get<double>();
  }
  EXPECT_GE(json.at("total_ms"), sum_ms);
  std::set<std::string> expected = before;
  expected.insert({out(1), out(6)});
  EXPECT_EQ(files(), expected);
  expect_fused_as_alone(1);
  expect_fused_as_alone(6);
}

TEST_F(Sequence, JsonIsReadableWhateverFilesAreCalled) {
  std::vector<std::string> arguments = fuse_frames("1", {"--json"});
  arguments[2] = "\xff.####.exr";
  const ProcessResult result = run(arguments);
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("'\xff.0001.exr'"), std::string::npos) << result.err;
  EXPECT_EQ(Json::parse(result.out).at("failed"), Json({1}));
}

// The weights turn any radiance of LRHS into infinities. The LRHS of the first and the last frame is black.
TEST_F(Sequence, AFrameThatFailsOnTheDeviceFailsAlone) {
  write_frames(1, 3);
  for (int frame : {1, 3}) write_image(folder_ / low(frame), kColorNames, Image(8, 6, 3));
  SafeTensors model = read_safetensors(tiny_model());
  for (float& weight : model.tensors.at("lrhs.weight").values) weight = 3e38f;
  write_safetensors(folder_ / "loud.safetensors", model);
  std::vector<std::string> arguments = fuse_frames("1-3", {"--precision", "fp32", "--kernels", "direct"});
  arguments[8] = "loud.safetensors";
  const ProcessResult result = run(arguments);
  EXPECT_EQ(result.exit_status, 2);
  EXPECT_NE(result.err.find("frame 2: model tiny-x4 gave"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("2 fused, 1 failed (2)"), std::string::npos) << result.err;
  EXPECT_TRUE(is_there(out(1)) && !is_there(out(2)) && is_there(out(3)));
}

TEST_F(Sequence, ResumeLeavesOutWhatIsDone) {
  write_frames(1, 3);
  const std::vector<std::string> arguments =
      fuse_frames("1-4", {"--preview", "view.####.png", "--dump", "layers.####", "--resume", "--json"});
  const auto fused = [&] {
    const ProcessResult result = run(arguments);
    EXPECT_NE(result.exit_status, -1) << result.err;
    return Json::parse(result.out).at("fused");
  };
  EXPECT_EQ(fused(), Json({1, 2, 3}));  // the fourth is not there yet
  write_frame(4);
  EXPECT_EQ(fused(), Json({4}));
  EXPECT_EQ(fused(), Json::array());
  for (const char* gone : {"out.0002.exr", "view.0002.png", "layers.0002/decode.npy"}) {
    fs::remove(folder_ / gone);
    EXPECT_EQ(fused(), Json({2})) << gone;
  }
  using std::chrono::milliseconds;
  for (const char* older : {"out.0003.exr", "view.0003.png", "layers.0003/decode.npy"}) {
    set_older(older, high(3), milliseconds(0));
    EXPECT_EQ(fused(), Json::array()) << older;
    set_older(older, high(3), milliseconds(1));
    EXPECT_EQ(fused(), Json({3})) << older;
  }
  // A run that has nothing to do takes no device.
  environment_["VK_DRIVER_FILES"] = environment_["VK_ICD_FILENAMES"] = "/nonexistent.json";
  EXPECT_EQ(run_json(arguments).at("skipped"), Json({1, 2, 3, 4}));
  // A missing input is not known to be older than the outputs, so its frame is not skipped.
  fs::remove(folder_ / low(1));
  EXPECT_EQ(run(arguments).exit_status, 2);
}

TEST_F(Sequence, ResumeFusesAgainWithANewerModel) {
  write_frames(1, 2);
  fs::copy_file(tiny_model(), folder_ / "mine.safetensors");
  std::vector<std::string> arguments = fuse_frames("1-2", {"--resume", "--json"});
  arguments[8] = "mine.safetensors";
  EXPECT_EQ(run_json(arguments).at("fused"), Json({1, 2}));
  EXPECT_EQ(run_json(arguments).at("skipped"), Json({1, 2}));
  set_older(out(1), "mine.safetensors", std::chrono::milliseconds(1));
  EXPECT_EQ(run_json(arguments).at("fused"), Json({1}));
}

TEST_F(Sequence, ShardsTakeEveryFrameOnce) {
  write_frames(1, 7);
  EXPECT_EQ(planned("1-7", {"--shard", "1/3"}), Json({1, 4, 7}));
  EXPECT_EQ(planned("1-7", {"--shard", "2/3"}), Json({2, 5}));
  EXPECT_EQ(planned("1-7", {"--shard", "3/3"}), Json({3, 6}));
  EXPECT_EQ(planned("1-7", {"--shard", "1/1"}), Json({1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(planned("1-2", {"--shard", "3/3"}), Json::array());
  EXPECT_EQ(run_json(fuse_frames("1-2", {"--shard", "3/3", "--json"})).at("frames"), Json::array());
  // Frames that are done still count when frames are dealt to shards.
  EXPECT_EQ(run_json(fuse_frames("1-7", {"--shard", "1/3", "--json"})).at("fused"), Json({1, 4, 7}));
  fs::remove(folder_ / out(4));
  const Json again = run_json(fuse_frames("1-7", {"--shard", "1/3", "--resume", "--json"}));
  EXPECT_EQ(again.at("fused"), Json({4}));
  EXPECT_EQ(again.at("skipped"), Json({1, 7}));
  for (const char* bad : {"0/3", "4/3", "3", "1/", "/3", "1/3/3", "1/0", "a/b", "1 / 3"})
    expect_error(fuse_frames("1-7", {"--shard", bad}), {"--shard", fmt::format("'{}'", bad), "2/8"});
}

TEST_F(Sequence, DryRunShowsTheFirstFrameAndWritesNothing) {
  write_frames(1, 3);
  ASSERT_EQ(run(fuse_frames("1")).exit_status, 0);
  const std::set<std::string> before = files();
  const ProcessResult text = run(fuse_frames("1-3", {"--resume", "--dry-run"}));
  EXPECT_EQ(text.exit_status, 0) << text.err;
  for (const char* part : {"2 frames to fuse (2-3), 1 to skip (1)", "frame 2:", "1 tile(s) of 8 x 6"})
    EXPECT_NE(text.out.find(part), std::string::npos) << part << " in " << text.out;
  const Json json = run_json(fuse_frames("1-3", {"--resume", "--dry-run", "--json"}));
  EXPECT_EQ(json.at("frames"), Json({2, 3}));
  EXPECT_EQ(json.at("skipped"), Json({1}));
  EXPECT_EQ(json.at("first").at("tile_width"), 8);
  EXPECT_EQ(files(), before);
}

TEST_F(Sequence, NotesAreOfTheFrameAndFewWhereNothingChanges) {
  write_frames(1, 4);
  write_frame(3, 16, 12);
  const std::string err = run(fuse_frames("1-4")).err;
  const auto count = [&](const std::string& text) {
    size_t found = 0;
    for (size_t at = err.find(text); at != std::string::npos; at = err.find(text, at + 1)) ++found;
    return found;
  };
  EXPECT_EQ(count("frame 1: fusing on "), 1u) << err;
  EXPECT_EQ(count("fusing on "), 1u) << err;
  EXPECT_EQ(count("found: LRHS is an ordinary small render"), 1u) << err;
  EXPECT_EQ(count("read low.####.exr, 8 x 6, and high.####.exr, 32 x 24: scale 4"), 2u) << err;
  EXPECT_EQ(count("frame 3: read low.####.exr, 16 x 12, and high.####.exr, 64 x 48: scale 4"), 1u) << err;
  for (int frame = 1; frame <= 4; ++frame)
    EXPECT_EQ(count(fmt::format("frame {}: wrote {}", frame, out(frame))), 1u) << err;
  EXPECT_EQ(count("color from"), 0u) << err;
  EXPECT_EQ(run(fuse_frames("1-4", {"--quiet"})).err, "");
  const std::string verbose = run(fuse_frames("1-2", {"--verbose"})).err;
  const size_t first = verbose.find("LRHS low.####.exr: color from R, G, B");
  EXPECT_NE(first, std::string::npos) << verbose;
  EXPECT_EQ(verbose.find("color from", first + 40), std::string::npos) << verbose;
}

TEST_F(Sequence, AnExposureThatDriftsIsSaid) {
  const std::string model = source_path("tests/golden/guided-x4.safetensors").string();
  const auto said = [&](float gain, const std::vector<std::string>& more) {
    for (const int frame : {1, 2, 3}) {
      write_frame(frame);
      Image low = random_image(kColorNames, 8, 6, 1);
      for (float& value : low.data) value *= frame == 2 ? gain : 1;
      write_image(folder_ / this->low(frame), kColorNames, low, Imf::FLOAT);
    }
    std::vector<std::string> arguments = fuse_frames("1-3", more);
    arguments[8] = model;
    return run(arguments).err;
  };
  const std::string drifts = said(1.2f, {});
  EXPECT_NE(drifts.find("the input exposure was found frame by frame, from "), std::string::npos) << drifts;
  EXPECT_NE(drifts.find(" (frame 2) to "), std::string::npos) << drifts;
  EXPECT_EQ(said(1.02f, {}).find("frame by frame"), std::string::npos);
  EXPECT_EQ(said(1.2f, {"--input-exposure", "0.5"}).find("frame by frame"), std::string::npos);
}

TEST_F(Sequence, TheNextFrameIsReadWhileOneIsFused) {
  write_frame(1);
  add_fault_layer();
  ASSERT_EQ(run(fuse_frames("1")).exit_status, 0);
  const std::string err =
      run_held("RAYMELD_HOLD_SUBMIT", submits(), fuse_frames("1,3"), "frame 3: cannot read").err;
  EXPECT_LT(err.find("frame 3: cannot read"), err.find("frame 1: wrote")) << err;
}

TEST_F(Sequence, TheLastFrameIsWrittenWhileOneIsFused) {
  write_frame(1);
  write_frame(2, 16, 12);  // its new size is logged when it is fused
  std::filesystem::create_directory(folder_ / "fused");
  add_sync_log();
  std::vector<std::string> command = fuse_frames("1-2");
  std::ranges::replace(command, std::string("out.####.exr"), std::string("fused/out.####.exr"));
  const std::string err = run_held("RAYMELD_HOLD_SYNC", "/fused/", command, "frame 2: read").err;
  EXPECT_LT(err.find("frame 2: read"), err.find("frame 1: wrote")) << err;
  EXPECT_NE(err.find("frame 2: wrote"), std::string::npos) << err;
}

// The program is held at frame 4 until it has got the signal.
TEST_F(Sequence, AnInterruptEndsAllAndLeavesWholeFrames) {
  write_frames(1, 8);
  add_fault_layer();
  ASSERT_EQ(run(fuse_frames("1-4")).exit_status, 0);
  for (int frame = 1; frame <= 4; ++frame) std::filesystem::remove(folder_ / out(frame));
  const std::set<std::string> before = files();
  const ProcessResult result =
      run_held("RAYMELD_HOLD_SUBMIT", submits(), fuse_frames("1-8"), "frame 2: wrote", {.signal = SIGINT});
  EXPECT_EQ(result.exit_status, 130) << result.err;
  for (const char* text : {"8 frames: ", " unfinished (", "cancelled"})
    EXPECT_NE(result.err.find(text), std::string::npos) << "'" << text << "' in: " << result.err;
  EXPECT_TRUE(is_there(out(1)) && is_there(out(2)) && !is_there(out(8)));
  for (const std::string& name : files())
    EXPECT_TRUE(before.contains(name) || name.starts_with("out.")) << name;
  for (int frame = 1; frame <= 8; ++frame) {
    const bool whole = result.err.find(fmt::format("frame {}: wrote", frame)) != std::string::npos;
    EXPECT_EQ(is_there(out(frame)), whole) << frame;
  }
}

TEST_F(Sequence, AFullStandardOutputIsAnError) {
  write_frame(1);
  for (const char* report : {"--json", "--profile"}) {
    std::vector<std::string> arguments = {"sh", "-c", "exec \"$@\" > /dev/full", "sh", RAYMELD_PROGRAM};
    const std::vector<std::string> command = fuse_frames("1", {report});
    arguments.insert(arguments.end(), command.begin(), command.end());
    const ProcessResult result =
        run_process(arguments, {.directory = folder_.path(), .environment = environment_});
    EXPECT_EQ(result.exit_status, 2);
    EXPECT_NE(result.err.find("standard output"), std::string::npos) << result.err;
  }
}

}  // namespace
}  // namespace raymeld::test
