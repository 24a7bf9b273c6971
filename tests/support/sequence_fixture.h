// Writes sequences of small frames, for the program to fuse.
#pragma once

#include <fmt/format.h>

#include "cli_fixture.h"

namespace raymeld::test {

class SequenceTest : public Cli {
 protected:
  static std::string low(int frame) { return fmt::format("low.{:04}.exr", frame); }
  static std::string high(int frame) { return fmt::format("high.{:04}.exr", frame); }
  static std::string out(int frame) { return fmt::format("out.{:04}.exr", frame); }

  // Writes an x4 pair of (height, width) LRHS pixels that is unlike any other frame's.
  void write_frame(int frame, int width = 8, int height = 6) const {
    const auto seed = uint64_t(frame);
    write_image(folder_ / low(frame), kColorNames, random_image(kColorNames, width, height, 2 * seed));
    write_image(folder_ / high(frame), kLayeredNames,
                random_image(kLayeredNames, 4 * width, 4 * height, 2 * seed + 1));
  }
  void write_frames(int first, int last) const {
    for (int frame = first; frame <= last; ++frame) write_frame(frame);
  }

  // Returns the arguments that fuse the frames to out.####.exr with the tiny model of scale 4.
  static std::vector<std::string> fuse_frames(const std::string& frames,
                                              const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"fuse",          "--lrhs",   "low.####.exr", "--hrls",
                                          "high.####.exr", "-o",       "out.####.exr", "--model",
                                          tiny_model(),    "--frames", frames};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  // Returns the image file that the frame gives alone.
  std::string fused_alone(int frame) const {
    const ProcessResult result = run(
        {"fuse", "--lrhs", low(frame), "--hrls", high(frame), "-o", "alone.exr", "--model", tiny_model()});
    EXPECT_EQ(result.exit_status, 0) << result.err;
    std::string image = read_file(folder_ / "alone.exr");
    std::filesystem::remove(folder_ / "alone.exr");
    return image;
  }

  bool is_there(const std::string& name) const { return std::filesystem::exists(folder_ / name); }
};

}  // namespace raymeld::test
