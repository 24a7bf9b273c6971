// Fuses sequences with --skip-unchanged: every frame comes out as it would without the option.
#include "sequence_fixture.h"

namespace raymeld::test {
namespace {

using Json = nlohmann::json;

class SequenceChanged : public SequenceTest {
 protected:
  static constexpr int kWidth = 72, kHeight = 24;
  inline static const std::vector<std::string> kTiled{"--max-memory", "3"};  // 3 MiB: several tiles

  void write(int frame) const {
    write_image(folder_ / low(frame), kAlphaNames, low_);
    write_image(folder_ / high(frame), kLayeredNames, high_);
  }

  Image low_ = random_image(kAlphaNames, kWidth, kHeight, 1),
        high_ = random_image(kLayeredNames, 4 * kWidth, 4 * kHeight, 2);
};

TEST_F(SequenceChanged, FramesAreWhatTheyWouldBeWithout) {
  write(1);
  low_.at(1, 3, 3) = 0.25f;
  write(2);
  high_.at(9, 0, 0) = 0;  // alpha, which is fused by itself
  write(3);
  const Image layers = high_;
  for (int c = 6; c < 9; ++c) std::fill_n(high_.plane(c), high_.plane_size(), 0.5f);
  write(4);  // the albedo is constant
  high_ = layers;
  high_.at(4, 90, 280) = -1;
  write(5);
  write_frame(6);  // the frame has another size
  write(7);
  low_.at(0, kHeight - 1, kWidth - 1) = 2;
  write(9);  // there is no frame 8
  EXPECT_EQ(run(fuse_frames("1-9", kTiled)).exit_status, 2);
  std::map<int, std::string> without;
  for (const int frame : {1, 2, 3, 4, 5, 6, 7, 9}) without[frame] = read_file(folder_ / out(frame));
  const ProcessResult result = run(fuse_frames("1-9", {"--skip-unchanged", "--json", kTiled[0], kTiled[1]}));
  EXPECT_EQ(result.exit_status, 2);
  const Json frames = Json::parse(result.out).at("frames");
  const auto skipped = [&](int frame) {
    return frames.at(size_t(frame) - 1).at("skipped_share").get<double>();
  };
  for (const int frame : {1, 4, 5, 6, 7}) EXPECT_EQ(skipped(frame), 0) << frame;
  for (const int frame : {2, 9}) {
    EXPECT_GT(skipped(frame), 0) << frame;
    EXPECT_LT(skipped(frame), 1) << frame;
  }
  // All of the color is skipped, and a part of alpha.
  EXPECT_GT(skipped(3), 0.5);
  EXPECT_LT(skipped(3), 1);
  EXPECT_EQ(frames.at(7).at("status"), "failed");
  for (const auto& [frame, image] : without) EXPECT_EQ(read_file(folder_ / out(frame)), image) << frame;
}

TEST_F(SequenceChanged, ItIsSaidAndMustFitTheOtherOptions) {
  for (const int frame : {1, 2}) write(frame);
  const ProcessResult result = run(fuse_frames("1-2", {"--skip-unchanged"}));
  EXPECT_EQ(result.exit_status, 0) << result.err;
  const size_t said =
      result.err.find("100 % of the frame is copied from the last one, as nothing changed there\n");
  ASSERT_NE(said, std::string::npos) << result.err;
  EXPECT_GT(said, result.err.find("frame 2: wrote ")) << result.err;
  EXPECT_EQ(result.err.find("100 % of the frame", said + 1), std::string::npos) << result.err;
  const std::string by_earlier_name = run(fuse_frames("1-2", {"--changed-only"})).err;
  EXPECT_NE(by_earlier_name.find("100 % of the frame is copied"), std::string::npos) << by_earlier_name;
  const auto expect_error = [&](const std::vector<std::string>& arguments, const std::string& other) {
    const ProcessResult refused = run(arguments);
    EXPECT_NE(refused.exit_status, 0);
    EXPECT_NE(refused.err.find("--skip-unchanged"), std::string::npos) << refused.err;
    EXPECT_NE(refused.err.find(other), std::string::npos) << refused.err;
  };
  expect_error(fuse({"--skip-unchanged"}), "--frames");
  expect_error(fuse_frames("1-2", {"--skip-unchanged", "--profile"}), "--profile");
  expect_error(fuse_frames("1-2", {"--skip-unchanged", "--dump", "layers.####"}), "--dump");
}

}  // namespace
}  // namespace raymeld::test
