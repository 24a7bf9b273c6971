// Tests frames that are joined with the ones before them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "error_of.h"
#include "fusion/fuser.h"
#include "golden.h"
#include "gpu.h"
#include "io/safetensors.h"
#include "support.h"

namespace raymeld::test {
namespace {

// Makes the frames of a sequence for a golden model. They are smooth, so that no pixel is a firefly.
class HistoryTest : public GpuTest {
 protected:
  struct Frame {
    std::vector<float> lrhs, hrls, motion;
  };

  static constexpr TileSize kSize{23, 41};  // of LRHS; frames are padded

  static uint32_t scale_of(const Model& model) { return model.architecture().scale; }
  static size_t pixels_of(const Model& model, TileSize size = kSize) {
    return size_t{scale_of(model)} * scale_of(model) * size.height * size.width;
  }

  static FuserOptions options_of(const Model& model, float hrls_spp, bool temporal, bool settles = true) {
    return {.temporal = temporal,
            .settles = settles,
            .compute_variance = true,
            .phase = lrhs_phase(true, scale_of(model)),
            .samples = {.lrhs = 16, .hrls = hrls_spp},
            .exposure = 0.5f};
  }

  // Returns a frame whose pattern has moved by so many pixels to the right since frame 0, with motion from
  // the frame before.
  static Frame make_frame(const Model& model, int moved = 0, int motion = 0, TileSize size = kSize) {
    const auto wave = [](double y, double x, int c) {
      return float(0.5 + 0.3 * std::sin(0.11 * x + 0.4 * c) * std::cos(0.07 * y - 0.3 * c));
    };
    const auto image = [&](uint32_t scale, int channels, double step) {
      std::vector<float> values;
      for (int c = 0; c < channels; ++c) {
        for (uint32_t y = 0; y < scale * size.height; ++y)
          for (uint32_t x = 0; x < scale * size.width; ++x)
            values.push_back(wave(step * (y + 0.5), step * (x + 0.5) - moved, c));
      }
      return values;
    };
    const uint32_t scale = scale_of(model);
    Frame frame{scale > 1 ? image(1, 3, scale) : std::vector<float>(), image(scale, 9, 1),
                std::vector<float>(2 * pixels_of(model, size))};
    std::fill_n(frame.motion.begin(), pixels_of(model, size), float(-motion));
    return frame;
  }

  static Fuser make_fuser(const Model& model, const FuserOptions& options, TileSize size = kSize) {
    return Fuser(gpu(), model, size.height, size.width, options, shared_cache_folder());
  }

  // Returns a frame of noise, whose light changes from frame to frame, with motion between pixels.
  static Frame make_noise(const Model& model, uint64_t seed, TileSize size) {
    Frame frame = make_frame(model, 0, 0, size);
    const auto fill = [&](std::vector<float>& values, uint64_t salt, double from, double to) {
      const reference::Planes noise =
          random_planes(1, 1, int(values.size()), Fill::kUniform, 100 * seed + salt);
      std::ranges::transform(noise.data, values.begin(),
                             [&](double u) { return float(from + (to - from) * (0.5 + 0.5 * u)); });
    };
    fill(frame.lrhs, 1, 0, 1 + double(seed % 2));
    fill(frame.hrls, 2, 0, 1 + double(seed % 2));
    fill(frame.motion, 3, -3, 3);
    return frame;
  }

  // Returns the frame with depths from 1 to 2, equal ones in both frames.
  static Frame with_depth(Frame frame, uint64_t seed) {
    const auto pixels = frame.motion.size() / 2;
    const reference::Planes noise = random_planes(1, 1, int(pixels), Fill::kUniform, 100 * seed + 4);
    for (int i = 0; i < 2; ++i)
      for (const double u : noise.data) frame.motion.push_back(float(1.5 + 0.5 * u));
    return frame;
  }

  static std::vector<float> fuse(Fuser& fuser, const Model& model, const Frame& frame, bool temporal = true,
                                 size_t sequence = 0) {
    std::vector<float> fused(3 * pixels_of(model, fuser.plan().tiling.frame));
    fuser.fuse(frame.lrhs.data(), frame.hrls.data(), fused.data(), {}, 0, sequence,
               temporal ? frame.motion.data() : nullptr);
    return fused;
  }

  static float difference(const std::vector<float>& a, const std::vector<float>& b) {
    float most = 0;
    for (size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
    return most;
  }
};

const char* const kModels[] = {"pyramid-x1", "pyramid-x2"};

// A mean of equal frames is the frame, of as many more samples.
TEST_F(HistoryTest, EqualFramesAreAFrameOfMoreSamples) {
  for (const char* name : kModels) {
    SCOPED_TRACE(name);
    const Model model(golden_model_path(name));
    const Frame frame = make_frame(model);
    Fuser fuser = make_fuser(model, options_of(model, 1.5f, true, false));
    std::vector<float> before;
    for (const int frames : {1, 2, 3}) {
      Fuser alone = make_fuser(model, options_of(model, 1.5f * float(frames), false));
      const std::vector<float> fused = fuse(fuser, model, frame);
      EXPECT_LE(difference(fused, fuse(alone, model, frame, false)), 2e-5f) << frames;
      if (frames > 1) {
        EXPECT_GT(difference(fused, before), 1e-4f) << "samples must matter to the network";
      }
      before = fused;
    }
  }
}

TEST_F(HistoryTest, AMovedFrameIsAFrameOfMoreSamplesWhereItWasSeenBefore) {
  const Model model(golden_model_path("pyramid-x1"));
  constexpr int kMoved = 3;
  Fuser fuser = make_fuser(model, options_of(model, 2, true, false));
  fuse(fuser, model, make_frame(model));
  const Frame moved = make_frame(model, kMoved, kMoved);
  const std::vector<float> fused = fuse(fuser, model, moved);
  Fuser alone = make_fuser(model, options_of(model, 4, false));
  const std::vector<float> of_four = fuse(alone, model, moved, false);
  // Returns the largest difference in some columns.
  const auto in_columns = [&](uint32_t first, uint32_t last) {
    float most = 0;
    for (size_t i = 0; i < fused.size(); ++i) {
      const size_t x = i % kSize.width;
      if (first <= x && x < last) most = std::max(most, std::abs(fused[i] - of_four[i]));
    }
    return most;
  };
  // New pixels come into sight at the left edge.
  EXPECT_GT(in_columns(0, kMoved), 1e-4f);
  EXPECT_LE(in_columns(kSize.width - 4, kSize.width), 2e-5f);
}

TEST_F(HistoryTest, TilesGiveTheSameBits) {
  for (const char* name : kModels) {
    SCOPED_TRACE(name);
    const Model model(golden_model_path(name));
    const TileSize size{16, 19 + 640 / scale_of(model)};
    for (const Storage storage : {Storage::kFloat32, Storage::kFloat16}) {
      FuserOptions options = options_of(model, 1, true);
      options.storage = storage;
      options.motion_depth = true;
      Fuser whole = make_fuser(model, options, size);
      options.max_memory_bytes = whole.plan().peak_bytes() - whole.plan().graph.activation_bytes() / 3;
      Fuser parts = make_fuser(model, options, size);
      EXPECT_EQ(whole.plan().tiling.count(), 1u);
      EXPECT_GT(parts.plan().tiling.count(), 1u);
      for (const int frame : {0, 1, 2}) {
        const Frame made = with_depth(make_noise(model, uint64_t(frame), size), uint64_t(frame));
        EXPECT_TRUE(same_bits(fuse(whole, model, made), fuse(parts, model, made))) << "frame " << frame;
      }
    }
  }
}

// The history is scene linear: a frame that is twice as bright to the network is the same frame.
TEST_F(HistoryTest, AnotherExposureKeepsTheHistory) {
  const Model model(golden_model_path("pyramid-x2"));
  const Frame frame = make_frame(model);
  std::vector<float> fused(3 * pixels_of(model)), expected(fused.size());
  Fuser fuser = make_fuser(model, options_of(model, 1, true, false)),
        other = make_fuser(model, options_of(model, 1, true, false));
  const auto fuse_at = [&](Fuser& with, float exposure, std::vector<float>& to) {
    with.fuse(frame.lrhs.data(), frame.hrls.data(), to.data(), {}, exposure, 0, frame.motion.data());
  };
  fuse_at(fuser, 0.25f, fused);
  fuse_at(fuser, 0.5f, fused);
  fuse_at(other, 0.5f, expected);
  fuse_at(other, 0.5f, expected);
  EXPECT_LE(difference(fused, expected), 2e-5f);
}

// What the network draws differs with the samples. After two frames the last one's image takes a third of
// that difference away.
TEST_F(HistoryTest, TheFusedImageChangesLessFromFrameToFrame) {
  for (const char* name : kModels) {
    SCOPED_TRACE(name);
    const Model model(golden_model_path(name));
    const Frame frame = make_frame(model);
    Fuser settled = make_fuser(model, options_of(model, 1, true)),
          other = make_fuser(model, options_of(model, 1, true, false));
    const std::vector<float> first = fuse(settled, model, frame);
    EXPECT_TRUE(same_bits(fuse(other, model, frame), first)) << "there is no last frame";
    const std::vector<float> mixed = fuse(settled, model, frame), drawn = fuse(other, model, frame);
    const float change = difference(drawn, first);
    EXPECT_GT(change, 1e-4f);
    EXPECT_LE(difference(mixed, first), 0.85f * change);
    EXPECT_GE(difference(mixed, first), 0.6f * change) << "two frames: the share is half of the largest";
    // The image before mixing is kept, so that only two frames are mixed.
    const std::vector<float> third = fuse(settled, model, frame), third_drawn = fuse(other, model, frame);
    EXPECT_LE(difference(third, third_drawn), 0.6f * difference(third_drawn, drawn));
  }
}

TEST_F(HistoryTest, FramesToRememberLeaveTheSameHistory) {
  const Model model(golden_model_path("pyramid-x2"));
  const uint32_t scale = scale_of(model);
  const auto image = [](const std::vector<float>& values, TileSize size) {
    const int pixels = int(size.height * size.width);
    Image result(int(size.width), int(size.height), int(values.size()) / pixels);
    result.data = values;
    return result;
  };
  const TileSize full{scale * kSize.height, scale * kSize.width};
  Fuser fused = make_fuser(model, options_of(model, 1, true)),
        remembered = make_fuser(model, options_of(model, 1, true));
  for (const uint64_t seed : {0, 1, 2}) {
    const Frame frame = make_noise(model, seed, kSize);
    fuse(fused, model, frame);
    remembered.remember(image(frame.lrhs, kSize), image(frame.hrls, full), image(frame.motion, full),
                        seed == 2);
  }
  const Frame last = make_noise(model, 3, kSize);
  EXPECT_TRUE(same_bits(fuse(fused, model, last), fuse(remembered, model, last)));
}

// A moving lamp leaves less of the history than a steady one.
TEST_F(HistoryTest, ChangedLightShortensTheHistory) {
  const Model model(golden_model_path("pyramid-x2"));
  const Frame frame = make_frame(model);
  const auto error_after = [&](float brightness) {
    Frame before = frame;
    for (float& value : before.lrhs) value *= brightness;
    std::transform(before.hrls.begin(), before.hrls.begin() + std::ptrdiff_t(3 * pixels_of(model)),
                   before.hrls.begin(), [&](float value) { return value * brightness; });
    Fuser fuser = make_fuser(model, options_of(model, 1, true)),
          alone = make_fuser(model, options_of(model, 1, true));
    fuse(fuser, model, before);
    return difference(fuse(fuser, model, frame), fuse(alone, model, frame));
  };
  EXPECT_LE(error_after(2), 0.1f * error_after(1.005f)) << "a two-hundredth is within what may be noise";
}

// After a step of the light each frame must be that of the new light: neither may the old one stay, nor may
// the step count again while LRHS's history catches up. What noise hides of the step may stay.
TEST_F(HistoryTest, AStepOfTheLightIsFollowedAtOnce) {
  const Model model(golden_model_path("pyramid-x2"));
  for (const auto& [step, noise, most] : {std::tuple(1.1f, 0.0f, 0.01),
                                          {0.9f, 0.0f, 0.01},
                                          {1.3f, 0.0f, 0.02},
                                          {3.0f, 0.0f, 0.01},
                                          {0.2f, 0.0f, 0.01},
                                          {1.1f, 0.1f, 0.03},
                                          {0.9f, 0.1f, 0.03}}) {
    SCOPED_TRACE(testing::Message() << "step " << step << ", noise " << noise);
    const auto lit = [&](float light, uint64_t seed) {
      Frame frame = make_frame(model);
      const reference::Planes drawn =
          random_planes(1, 1, int(kSize.height * kSize.width), Fill::kUniform, seed);
      for (size_t i = 0; i < frame.lrhs.size(); ++i)
        frame.lrhs[i] *= light * (1 + noise * float(drawn.data[i % drawn.data.size()]));
      std::for_each_n(frame.hrls.begin(), 3 * pixels_of(model), [&](float& value) { value *= light; });
      return frame;
    };
    const auto mean = [](const std::vector<float>& image) {
      return std::accumulate(image.begin(), image.end(), 0.0) / double(image.size());
    };
    Fuser fuser = make_fuser(model, options_of(model, 1, true, false)),
          steady = make_fuser(model, options_of(model, 1, true, false));
    double truth = 0;
    for (uint64_t frame = 1; frame <= 20; ++frame) {
      fuse(fuser, model, lit(1, frame));
      truth = mean(fuse(steady, model, lit(step, frame)));
    }
    for (uint64_t frame = 21; frame <= 40; ++frame)
      EXPECT_NEAR(mean(fuse(fuser, model, lit(step, frame))) / truth, 1, most) << "frame " << frame;
  }
}

// LRHS of other noise, which changes single pixels by up to a third, keeps most of the history.
TEST_F(HistoryTest, NoiseOfLrhsIsNoChangeOfTheLight) {
  const Model model(golden_model_path("pyramid-x2"));
  Frame before = make_frame(model), now = before;
  for (Frame* frame : {&before, &now}) {
    const reference::Planes noise =
        random_planes(1, 1, int(kSize.height * kSize.width), Fill::kUniform, frame == &now ? 1 : 2);
    for (size_t i = 0; i < frame->lrhs.size(); ++i)
      frame->lrhs[i] *= float(1 + noise.data[i % noise.data.size()] / 3);
  }
  Fuser fuser = make_fuser(model, options_of(model, 1, true, false));
  fuse(fuser, model, before);
  const std::vector<float> fused = fuse(fuser, model, now);
  const auto mean_difference = [&](float samples) {
    Fuser alone = make_fuser(model, options_of(model, samples, false));
    const std::vector<float> other = fuse(alone, model, now, false);
    double sum = 0;
    for (size_t i = 0; i < fused.size(); ++i) sum += std::abs(fused[i] - other[i]);
    return sum / double(fused.size());
  };
  EXPECT_LE(mean_difference(2), 0.5 * mean_difference(1));
}

TEST_F(HistoryTest, SequencesAndResetsBeginAnew) {
  const Model model(golden_model_path("pyramid-x2"));
  const Frame frame = make_frame(model);
  Fuser fuser = make_fuser(model, options_of(model, 1, true));
  const std::vector<float> first = fuse(fuser, model, frame);
  const std::vector<float> second = fuse(fuser, model, frame);
  EXPECT_FALSE(same_bits(second, first));
  EXPECT_TRUE(same_bits(fuse(fuser, model, frame, true, 7), first));
  fuser.reset_history();
  EXPECT_TRUE(same_bits(fuse(fuser, model, frame), first));
  EXPECT_TRUE(same_bits(fuse(fuser, model, frame, true, 7), second));
}

TEST_F(HistoryTest, AFrameThatEndsEarlyLeavesTheHistory) {
  const Model model(golden_model_path("pyramid-x2"));
  const Frame frame = make_frame(model);
  const FuserOptions options = options_of(model, 1, true);
  Fuser stopped = make_fuser(model, options), other = make_fuser(model, options);
  for (Fuser* fuser : {&stopped, &other}) fuse(*fuser, model, frame);
  std::vector<float> fused(3 * pixels_of(model));
  EXPECT_THROW(stopped.fuse(
                   frame.lrhs.data(), frame.hrls.data(), fused.data(), [](double) { return false; }, 0, 0,
                   frame.motion.data()),
               Cancelled);
  EXPECT_TRUE(same_bits(fuse(stopped, model, frame), fuse(other, model, frame)));
}

TEST_F(HistoryTest, AFrameThatIsNotFiniteLeavesTheHistory) {
  SafeTensors file = read_safetensors(golden_model_path("pyramid-x1"));
  for (float& weight : file.tensors.at("hrls.weight").values) weight = weight < 0 ? -1e38f : 1e38f;
  const Model model(file, "steep");
  const Frame frame = make_frame(model);
  Frame dark = frame;
  std::ranges::fill(dark.hrls, 0.0f);
  Fuser fuser = make_fuser(model, options_of(model, 1, true));
  const auto saved = [&] {
    std::vector<std::byte> bytes(fuser.saved_history_bytes());
    fuser.save_history(bytes);
    return bytes;
  };
  fuse(fuser, model, dark);
  const std::vector<std::byte> before = saved();
  EXPECT_THROW(fuse(fuser, model, frame), NotFinite);
  EXPECT_EQ(saved(), before);
  fuse(fuser, model, dark);
  EXPECT_NE(saved(), before);
}

// Samples that miss a thin thing have another albedo. They keep their history unless the motion has changed.
TEST_F(HistoryTest, AnotherAlbedoKeepsTheHistoryWhereTheMotionIsSteady) {
  for (const char* name : kModels) {
    SCOPED_TRACE(name);
    const Model model(golden_model_path(name));
    const auto difference_from_a_first_frame = [&](int motion) {
      Frame frame = make_frame(model, motion, motion);
      const auto albedo = frame.hrls.begin() + std::ptrdiff_t(3 * pixels_of(model));
      std::for_each_n(albedo, 3 * pixels_of(model), [](float& value) { value += 0.4f; });
      Fuser fuser = make_fuser(model, options_of(model, 1, true, false)),
            alone = make_fuser(model, options_of(model, 1, true, false));
      for (int i = 0; i < 3; ++i) fuse(fuser, model, make_frame(model));
      return difference(fuse(fuser, model, frame), fuse(alone, model, frame));
    };
    EXPECT_LE(difference_from_a_first_frame(1), 0.05f * difference_from_a_first_frame(0));
  }
}

// What has the albedo and the normal of the last frame's surface, but another depth, was not seen before.
TEST_F(HistoryTest, ASurfaceOfAnotherDepthBeginsAnew) {
  for (const char* name : kModels) {
    SCOPED_TRACE(name);
    const Model model(golden_model_path(name));
    FuserOptions options = options_of(model, 1, true, false);
    options.motion_depth = true;
    const auto at_depth = [&](Frame frame, float now, float before) {
      for (const float depth : {now, before})
        frame.motion.insert(frame.motion.end(), pixels_of(model), depth);
      return frame;
    };
    const auto difference_from_a_first_frame = [&](float now, float before) {
      Fuser fuser = make_fuser(model, options), alone = make_fuser(model, options);
      for (int i = 0; i < 3; ++i) fuse(fuser, model, at_depth(make_frame(model), 2, 2));
      const Frame frame = at_depth(make_frame(model, 1, 1), now, before);
      return difference(fuse(fuser, model, frame), fuse(alone, model, frame));
    };
    const float kept = difference_from_a_first_frame(3, 2);  // it has gone away
    EXPECT_LE(difference_from_a_first_frame(3, 3), 0.05f * kept);
    EXPECT_EQ(difference_from_a_first_frame(2.05f, 2.05f), kept) << "within the tolerance";
    EXPECT_EQ(difference_from_a_first_frame(3, 0), kept) << "it is not known";
  }
}

// No pixel of such a frame was seen before, wherever its motion leads.
TEST_F(HistoryTest, MotionThatLeadsNowhereIsAFirstFrame) {
  const Model model(golden_model_path("pyramid-x2"));
  Frame frame = make_frame(model);
  Fuser fuser = make_fuser(model, options_of(model, 1, true));
  const std::vector<float> first = fuse(fuser, model, frame);
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float nowhere :
       {std::numeric_limits<float>::quiet_NaN(), kInfinity, -kInfinity, 1e30f, -200.0f}) {
    std::ranges::fill(frame.motion, nowhere);
    EXPECT_TRUE(same_bits(fuse(fuser, model, frame), first)) << nowhere;
  }
}

TEST_F(HistoryTest, WhatKeepsNoHistorySaysSo) {
  const Model model(golden_model_path("pyramid-x2"));
  const Frame frame = make_frame(model);
  const FuserOptions options = options_of(model, 1, true);
  const auto refused = [&](const Model& of, const FuserOptions& with) {
    return error_of([&] { make_fuser(of, with); });
  };
  const auto has = [](const std::string& text, const char* part) {
    return text.find(part) != std::string::npos;
  };
  FuserOptions other = options;
  other.phase = 0;
  EXPECT_TRUE(has(refused(model, other), "ordinary small render"));
  other = options;
  other.compute_variance = false;
  EXPECT_TRUE(has(refused(model, other), "variance"));
  other = options;
  other.skip_unchanged = true;
  EXPECT_TRUE(has(refused(model, other), "is skipped"));
  other = options;
  other.fp32_kernels.emplace();
  EXPECT_TRUE(has(refused(model, other), "one precision"));
  for (const char* name : {"pyramid-x4", "tiny-x2", "kpcn-x1", "edsr-x4"})
    EXPECT_TRUE(has(refused(Model(golden_model_path(name)), options), "keeps no history")) << name;

  Fuser fuser = make_fuser(model, options);
  EXPECT_TRUE(has(error_of([&] { fuse(fuser, model, frame, false); }), "without motion"));
  Fuser alone = make_fuser(model, options_of(model, 1, false));
  EXPECT_TRUE(has(error_of([&] { fuse(alone, model, frame); }), "with motion"));
}

}  // namespace
}  // namespace raymeld::test
