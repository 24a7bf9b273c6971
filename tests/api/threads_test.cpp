// Runs threads on one device, and processes with one cache: each gets the bits that it would get alone.
#include <atomic>
#include <functional>
#include <thread>

#include "api_subject.h"
#include "cli_fixture.h"
#include "fusion/fuser.h"
#include "fusion/tuner.h"

namespace raymeld::test {
namespace {

constexpr int kThreads = 4, kFrames = 3;

// Calls work(0) to work(kThreads - 1) at once.
void in_threads(const std::function<void(int)>& work) {
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) threads.emplace_back(work, i);
  for (std::thread& thread : threads) thread.join();
}

// Each thread has a frame of its own, of its own size.
class ThreadsTest : public GpuTest {
 protected:
  ThreadsTest() {
    set_cache_home(folder_ / "cache");
    for (int i = 0; i < kThreads; ++i) {
      subjects_.push_back(
          make_subject(i % 2 ? guided_architecture(4) : small_architecture(2), 5 + i, 9 - i, uint64_t(i)));
      write_model(file(i), subjects_.back().architecture, subjects_.back().weights);
    }
  }

  std::string file(int i) const { return folder_ / fmt::format("{}.safetensors", i); }
  uint32_t height(int i) const { return uint32_t(subjects_[size_t(i)].lrhs.h); }
  uint32_t width(int i) const { return uint32_t(subjects_[size_t(i)].lrhs.w); }

  std::vector<float> fuse_with(Fuser& fuser, int i) const {
    Image fused;
    fuser.fuse(image_of(subjects_[size_t(i)].lrhs), image_of(subjects_[size_t(i)].hrls), fused);
    return fused.data;
  }
  std::vector<float> fuse_with(Fusion& fusion, int i) const {
    return fuse(fusion, subjects_[size_t(i)]).values;
  }

  // Calls make(i) and fuses with the result, first one after the other in one thread and then in all threads
  // at once, and expects the same bits.
  template <typename Make>
  void expect_the_same(Make&& make) {
    std::vector<std::vector<float>> alone(kThreads), together(size_t{kThreads} * kFrames);
    for (int i = 0; i < kThreads; ++i) alone[size_t(i)] = fuse_with(*make(i), i);
    in_threads([&](int i) {
      const auto own = make(i);
      for (int frame = 0; frame < kFrames; ++frame)
        together[size_t(i * kFrames + frame)] = fuse_with(*own, i);
    });
    for (size_t k = 0; k < together.size(); ++k) {
      EXPECT_TRUE(same_bits(together[k], alone[k / kFrames])) << "thread " << k / kFrames;
    }
  }

  TemporaryDirectory folder_;
  std::vector<Subject> subjects_;
};

TEST_F(ThreadsTest, FusersOfOneDevice) {
  std::vector<std::unique_ptr<Model>> models;
  for (int i = 0; i < kThreads; ++i) models.push_back(std::make_unique<Model>(file(i)));
  const Kernels kernels = default_kernels(gpu().info(), Storage::kFloat32);
  expect_the_same([&](int i) {
    return std::make_unique<Fuser>(gpu(), *models[size_t(i)], height(i), width(i),
                                   FuserOptions{.kernels = kernels}, folder_ / "cache");
  });
  EXPECT_TRUE(PipelineCache(gpu(), folder_ / "cache").loaded());
}

TEST_F(ThreadsTest, FusionsWithDevicesOfTheirOwn) {
  expect_the_same([&](int i) {
    return std::make_unique<Fusion>(Context(), SharedModel(file(i)), fusion_desc(subjects_[size_t(i)]));
  });
}

TEST_F(ThreadsTest, FusionsOfACallersDevice) {
  const CallerDevice caller;
  const Context context(context_desc(caller.external()));
  expect_the_same([&](int i) {
    return std::make_unique<Fusion>(context, SharedModel(file(i)), fusion_desc(subjects_[size_t(i)]));
  });
}

class ProcessesTest : public Cli {
 protected:
  // Runs all commands at once, each of which must succeed.
  void run_together(const std::vector<std::vector<std::string>>& commands) const {
    std::vector<ProcessResult> results(commands.size());
    std::vector<std::thread> threads;
    for (size_t i = 0; i < commands.size(); ++i)
      threads.emplace_back([&, i] { results[i] = run(commands[i]); });
    for (std::thread& thread : threads) thread.join();
    for (const ProcessResult& result : results) EXPECT_EQ(result.exit_status, 0) << result.err;
  }

  static std::vector<std::string> fuse_to(const std::string& output) {
    return {"fuse", "--lrhs", "low.exr", "--hrls", "high.exr", "--model", tiny_model(), "-o", output};
  }
};

TEST_F(ProcessesTest, FusingWithOneCache) {
  ASSERT_EQ(run(fuse_to("alone.exr")).exit_status, 0);
  const std::filesystem::path cache = folder_ / "cache" / "raymeld";
  std::filesystem::remove_all(folder_ / "cache");
  run_together({fuse_to("a.exr"), fuse_to("b.exr"), fuse_to("same.exr"), fuse_to("same.exr")});
  for (const char* name : {"a.exr", "b.exr", "same.exr"})
    EXPECT_EQ(read_file(folder_ / name), read_file(folder_ / "alone.exr")) << name;
  EXPECT_TRUE(PipelineCache(gpu(), cache).loaded());
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(cache), {}), 1);  // no half-written file
}

// Two threads save and two load. A loaded tuning must be, as a whole, one that a single thread saved.
TEST(Tunings, SavedAndLoadedAtOnce) {
  const TemporaryDirectory folder;
  const std::filesystem::path file = folder / "cache" / "tuning.json";
  std::array<Tuning, 2> tunings;
  tunings[0].order = 1, tunings[1].order = 2;
  for (uint32_t channels = 1; channels <= 40; ++channels) {
    for (Tuning& tuning : tunings)
      tuning.entries[{.height = 64,
                      .width = 64,
                      .channels_in = channels,
                      .channels_out = channels * tuning.order,
                      .kernel = 3}] = {.kernel = {}, .time_ms = double(tuning.order), .direct_ms = 1};
  }
  save_tuning(file, tunings[0]);
  std::atomic<int> wrong = 0;
  in_threads([&](int i) {
    for (int round = 0; round < 50; ++round) {
      if (i < 2) {
        save_tuning(file, tunings[size_t(i)]);
      } else {
        const Tuning loaded = load_tuning(file);
        const bool is_whole = loaded.entries.size() == 40 && (loaded.order == 1 || loaded.order == 2);
        wrong += !is_whole || loaded.entries.begin()->second.time_ms != loaded.order;
      }
    }
  });
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder / "cache"), {}), 1);
}

}  // namespace
}  // namespace raymeld::test
