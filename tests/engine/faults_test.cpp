// Tests that any Vulkan call may fail: an error says what was being done, no object is left, and the next
// frame is right.
#include "faults.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "caller_device.h"
#include "engine/buffer.h"
#include "engine/commands.h"
#include "error_of.h"
#include "fusion/fuser.h"
#include "fusion/tuner.h"
#include "golden.h"
#include "subject.h"

namespace raymeld::test {
namespace {

using Calls = std::map<std::string, int>;

// Holds the result of a frame: an error, or values.
struct Outcome {
  std::string error, shortage;
  std::vector<float> values;
  uint32_t tiles = 0, redone_tiles = 0;
};

// Returns a network of few kernels, as drivers take their time with each.
reference::Architecture least_architecture() {
  return {.scale = 2,
          .features = 2,
          .growth = 2,
          .dense_layers = 1,
          .blocks = 1,
          .groups = 1,
          .hrls_layers = {reference::LayerKind::kRadiance},
          .clip = 100};
}

class FaultsTest : public testing::Test {
 protected:
  Model model_of(const Subject& subject) const { return saved_model(folder_.path(), subject); }

  std::vector<float> fuse(Fuser& fuser) const {
    Image fused;
    fuser.fuse(image_of(subject_.lrhs), image_of(subject_.hrls), fused);
    return fused.data;
  }

  // Runs a whole frame, from wrapping the device to destroying all objects.
  Outcome run(const CallerDevice& caller, const FuserOptions& options) const {
    Outcome outcome;
    interposed().discrete = discrete_;
    try {
      const std::unique_ptr<Device> device = Device::wrap(caller.external());
      Fuser fuser(*device, model_, uint32_t(subject_.lrhs.h), uint32_t(subject_.lrhs.w), options, cache());
      Image fused;
      outcome.redone_tiles = fuser.fuse(image_of(subject_.lrhs), image_of(subject_.hrls), fused).redone_tiles;
      outcome.values = fused.data;
      outcome.shortage = fuser.shortage();
      outcome.tiles = fuser.plan().tiling.count();
    } catch (const Error& error) {
      outcome.error = error.what();
    }
    return outcome;
  }

  std::filesystem::path cache() const { return folder_ / "cache"; }

  int check_every_call(VkResult code, const FuserOptions& options, int first = 1, int step = 1);

  bool discrete_ = false;  // run()'s device has memory of its own
  TemporaryDirectory folder_;
  Subject subject_ = make_subject(least_architecture(), 12, 40, 1);
  Model model_ = model_of(subject_);
  // These options make several submits and every kind of call.
  const FuserOptions all_{.profile = true,
                          .work_limits = WorkLimits{.dispatch_work = 1e5, .submit_work = 3e5}};
};

// Returns whether the call that failed is made before there is a tile that could be made smaller. The first
// fence is the device's, and those of staged copies come with the tiles. The first pipeline cache is the
// frame's, and the second is that of the Fuser for tiles that are done again.
bool comes_before_tiles(const std::string& function) {
  const bool first = !interposed().alive_at_failure.contains(function);
  return function == "vkEnumerateDeviceExtensionProperties" ||
         function == "vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR" ||
         (first && (function == "vkCreatePipelineCache" || function == "vkCreateFence"));
}

// Returns whether a frame survives the fault: it is made again in less memory, or needs no cache on disk.
bool is_survived(const std::string& function, VkResult code) {
  if (function == "vkGetPipelineCacheData") return true;
  const bool out_of_memory = code == VK_ERROR_OUT_OF_DEVICE_MEMORY ||
                             (code == VK_ERROR_OUT_OF_HOST_MEMORY && function == "vkAllocateMemory");
  return out_of_memory && !comes_before_tiles(function);
}

// Returns whether the error starts like "allocating memory: VK_ERROR_OUT_OF_DEVICE_MEMORY".
bool says_what_was_done(const std::string& error, VkResult code) {
  const size_t colon = error.find(": ");
  return error.substr(0, error.find(' ')).ends_with("ing") && colon != std::string::npos &&
         error.substr(colon + 2).starts_with(result_name(code));
}

// Fails the calls that may return `code`, one in each run: every `step`th from `first` on, and at quick
// extent every fifth of these. Returns the number of such calls.
int FaultsTest::check_every_call(VkResult code, const FuserOptions& options, int first, int step) {
  const bool lost = code == VK_ERROR_DEVICE_LOST;
  auto caller = std::make_unique<CallerDevice>();
  const Outcome sound = run(*caller, options);
  EXPECT_EQ(sound.error, "");
  const std::string device_name = Device::wrap(caller->external())->info().name;
  int tried = 0;
  for (int call = first;; call += step * (full_extent() ? 1 : 5)) {
    interposed().fault = {.call = call, .code = code};
    interposed().failures = 0;
    const Outcome outcome = run(*caller, options);
    interposed().fault = {};
    if (interposed().failures == 0) return (call - first) / step;
    const std::string failed = interposed().failed;
    SCOPED_TRACE(fmt::format("call {}, {}: {}", call, failed, result_name(code)));
    EXPECT_EQ(interposed().alive, Calls{});
    if (is_survived(failed, code)) {
      EXPECT_EQ(outcome.error, "");
      EXPECT_TRUE(same_bits(outcome.values, sound.values));
      EXPECT_EQ(outcome.shortage.empty(), failed == "vkGetPipelineCacheData");
      EXPECT_TRUE(outcome.tiles > sound.tiles || outcome.shortage.empty() || options.fp32_kernels);
    } else {
      EXPECT_TRUE(says_what_was_done(outcome.error, code)) << outcome.error;
      EXPECT_TRUE(!lost || contains(outcome.error, device_name)) << outcome.error;
    }
    if (lost) caller = std::make_unique<CallerDevice>();
    if (++tried % 8 == 0 || lost) {
      const Outcome next = run(*caller, options);
      EXPECT_EQ(next.error, "");
      EXPECT_TRUE(same_bits(next.values, sound.values));
    }
    if (HasFailure()) return call;
  }
}

TEST_F(FaultsTest, OutOfHostMemory) { EXPECT_GT(check_every_call(VK_ERROR_OUT_OF_HOST_MEMORY, all_), 100); }

TEST_F(FaultsTest, OutOfDeviceMemoryInOddCalls) {
  EXPECT_GT(check_every_call(VK_ERROR_OUT_OF_DEVICE_MEMORY, all_, 1, 2), 50);
}

TEST_F(FaultsTest, OutOfDeviceMemoryInEvenCalls) {
  EXPECT_GT(check_every_call(VK_ERROR_OUT_OF_DEVICE_MEMORY, all_, 2, 2), 50);
}

TEST_F(FaultsTest, DeviceLost) { EXPECT_GT(check_every_call(VK_ERROR_DEVICE_LOST, all_), 6); }

// The frame makes a second Fuser on its way, for tiles that fp16 cannot hold.
TEST_F(FaultsTest, WhileTilesAreDoneAgain) {
  for (double& w : subject_.weights.at("rec").weight) w = w < 0 ? -6e4 : 6e4;
  model_ = model_of(subject_);
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  if (!device->info().storage_16bit) GTEST_SKIP() << "no 16-bit storage";
  FuserOptions options = all_;
  options.storage = Storage::kFloat16;
  options.fp32_kernels = Kernels{};
  Fuser fuser(*device, model_, 12, 40, options, cache());
  Image fused;
  EXPECT_EQ(fuser.fuse(image_of(subject_.lrhs), image_of(subject_.hrls), fused).redone_tiles, 1u);
  for (const VkResult code : {VK_ERROR_OUT_OF_HOST_MEMORY, VK_ERROR_OUT_OF_DEVICE_MEMORY})
    EXPECT_GT(check_every_call(code, options, 3, 7), 20);
  EXPECT_GT(check_every_call(VK_ERROR_DEVICE_LOST, options), 6);
}

// Fails each call of `work` in turn: `work` must throw, and then succeed. Returns the number of calls.
template <typename Work>
int check_that_it_can_be_repeated(VkResult code, const Work& work) {
  work();
  for (int call = 1;; ++call) {
    interposed().failures = 0;
    interposed().fault = {.call = call, .code = code};
    std::string error;
    try {
      work();
    } catch (const Error& thrown) {
      error = thrown.what();
    }
    interposed().fault = {};
    if (interposed().failures == 0) return call - 1;
    EXPECT_TRUE(contains(error, result_name(code))) << interposed().failed << ": " << error;
    work();
  }
}

TEST_F(FaultsTest, AFuserOutlivesAFrameThatFailed) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  FuserOptions options = all_;
  options.keep_activations = true;
  Fuser fuser(*device, model_, 12, 40, options, cache());
  const std::vector<float> expected = fuse(fuser);
  const Tensor layer = *fuser.graph().layers().front()->output();
  const std::vector<float> values = fuser.program().read(layer);
  for (const VkResult code : {VK_ERROR_OUT_OF_HOST_MEMORY, VK_ERROR_OUT_OF_DEVICE_MEMORY}) {
    const Calls alive = interposed().alive;
    EXPECT_GT(check_that_it_can_be_repeated(code, [&] { EXPECT_EQ(fuse(fuser), expected); }), 9);
    EXPECT_GT(check_that_it_can_be_repeated(code, [&] { EXPECT_EQ(fuser.program().read(layer), values); }),
              9);
    EXPECT_EQ(interposed().alive, alive);
  }
}

TEST_F(FaultsTest, ALostDeviceStaysLostAndAFreshOneWorks) {
  CallerDevice lost, fresh;
  const std::unique_ptr<Device> device = Device::wrap(lost.external());
  Fuser fuser(*device, model_, 12, 40, all_, cache());
  const std::vector<float> expected = fuse(fuser);
  interposed().device = lost.external().device;
  interposed().fault = {.function = "vkWaitForFences", .call = 2, .code = VK_ERROR_DEVICE_LOST};
  EXPECT_THROW(fuse(fuser), DeviceLost);
  EXPECT_ERROR(fuse(fuser), "submitting to " + device->info().name, "VK_ERROR_DEVICE_LOST", "another device");
  interposed().fault = {};
  EXPECT_TRUE(same_bits(run(fresh, all_).values, expected));
}

TEST_F(FaultsTest, ALostDeviceEndsATuning) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  if (!device->info().buffer_device_address) GTEST_SKIP() << "there is one kernel only to be measured";
  PipelineCache pipelines(*device, {});
  Tuning tuning;
  const Conv2dShape known{.height = 8, .width = 8, .channels_in = 4, .channels_out = 4, .kernel = 1};
  const Conv2dShape shape{.height = 16, .width = 16, .channels_in = 4, .channels_out = 4, .kernel = 3};
  tuning.entries[known] = {};
  // The direct kernel, which comes first, takes 17 waits at most.
  interposed().fault = {.function = "vkWaitForFences", .call = 20, .code = VK_ERROR_DEVICE_LOST};
  const auto ignore = [](const Conv2dShape&, const Tuning::Entry&) { return true; };
  EXPECT_THROW(tune(*device, pipelines, Storage::kFloat32, {shape}, tuning, ignore), DeviceLost);
  EXPECT_GT(interposed().failures, 0);
}

TEST_F(FaultsTest, TooFewStorageBuffersAreAnErrorThatNamesTheLayer) {
  CallerDevice caller;
  interposed().most_storage_buffers = 3;
  const std::string error = run(caller, {.kernels = Kernels{}}).error;
  EXPECT_TRUE(contains(error, "layer ") && contains(error, " storage buffers; device ")) << error;
  EXPECT_TRUE(error.ends_with("binds at most 3")) << error;
  interposed().most_storage_buffers = 9;  // conv2d has as many
  EXPECT_EQ(run(caller, {.kernels = Kernels{}}).error, "");
}

TEST_F(FaultsTest, TimestampsStartAgainAtTheirLastBit) {
  CallerDevice caller;
  interposed().timestamp_bits = 36;
  const DeviceInfo some = Device::wrap(caller.external())->info();
  const double period_ms = some.timestamp_period_ns * 1e-6;
  EXPECT_DOUBLE_EQ(some.ms_between(100, 350), 250 * period_ms);
  EXPECT_DOUBLE_EQ(some.ms_between((uint64_t{1} << 36) - 100, 150), 250 * period_ms);
  interposed().timestamp_bits = 64;
  EXPECT_DOUBLE_EQ(Device::wrap(caller.external())->info().ms_between(~uint64_t{99}, 150), 250 * period_ms);
  interposed().timestamp_bits = 0;
  EXPECT_TRUE(contains(run(caller, {.profile = true}).error, "no timestamps"));
  EXPECT_EQ(run(caller, {}).error, "");
}

// The host's data reach the device's own memory by copies, also those of tiles.
TEST_F(FaultsTest, ADeviceWithMemoryOfItsOwnGivesTheSameBits) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const FuserOptions whole;
  FuserOptions tiles;
  tiles.max_memory_bytes = plan_fusion(model_, 12, 40, device->info(), {}).peak_bytes() / 4 * 3;
  for (const FuserOptions& options : {whole, tiles}) {
    discrete_ = false;
    const Outcome shared = run(caller, options);
    interposed().copies.clear();
    discrete_ = true;
    const Outcome copied = run(caller, options);
    EXPECT_EQ(copied.error, "");
    EXPECT_TRUE(same_bits(copied.values, shared.values));
    const auto copies = std::ranges::count(interposed().copies, "copy");
    EXPECT_GE(copies, 2 * copied.tiles);
  }
}

TEST_F(FaultsTest, ADeviceWithMemoryOfItsOwnComputesTilesAgain) {
  for (double& w : subject_.weights.at("rec").weight) w = w < 0 ? -6e4 : 6e4;
  model_ = model_of(subject_);
  CallerDevice caller;
  FuserOptions options;
  options.storage = Storage::kFloat16;
  options.fp32_kernels = Kernels{};
  options.max_memory_bytes =
      plan_fusion(model_, 12, 40, Device::wrap(caller.external())->info(), options).peak_bytes() / 8 * 7;
  const Outcome shared = run(caller, options);
  discrete_ = true;
  const Outcome copied = run(caller, options);
  EXPECT_GT(copied.redone_tiles, 0u);
  EXPECT_EQ(copied.redone_tiles, shared.redone_tiles);
  EXPECT_EQ(copied.error, "");
  EXPECT_TRUE(same_bits(copied.values, shared.values));
}

// The copies of a larger image need several pieces of host memory, each more than once.
TEST_F(FaultsTest, CopiesInPiecesGiveTheSameBits) {
  subject_ = make_subject(least_architecture(), 300, 200, 2);
  model_ = model_of(subject_);
  CallerDevice caller;
  const Outcome shared = run(caller, {});
  interposed().copies.clear();
  discrete_ = true;
  const Outcome copied = run(caller, {});
  EXPECT_EQ(copied.error, "");
  EXPECT_GT(std::ranges::count(interposed().copies, "copy"), 4);
  EXPECT_TRUE(same_bits(copied.values, shared.values));
}

TEST_F(FaultsTest, EveryCallMayFailWhereTheDeviceHasMemoryOfItsOwn) {
  discrete_ = true;
  EXPECT_GT(check_every_call(VK_ERROR_OUT_OF_DEVICE_MEMORY, {}, 3, 3), 20);
  EXPECT_GT(check_every_call(VK_ERROR_DEVICE_LOST, {}), 6);
}

// What was read may have been written by a shader of an earlier submit.
TEST_F(FaultsTest, CopiesWaitForShaders) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Buffer from(*device, 64, Memory::kDevice, "from"), to(*device, 64, Memory::kDevice, "to");
  copy_now(*device, from.handle(), to.handle(), {0, 0, 64}, "copy");
  EXPECT_EQ(interposed().copies, (std::vector<std::string>{"barrier", "copy"}));
}

// The device has less memory than it says.
TEST_F(FaultsTest, TilesBecomeAsSmallAsTheMemory) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  for (const Kernels& kernels : {Kernels{}, default_kernels(device->info(), Storage::kFloat32)}) {
    const FuserOptions options{.kernels = kernels};
    const Outcome whole = run(caller, options);
    interposed().most_allocation_bytes =
        plan_fusion(model_, 12, 40, device->info(), options).graph.activation_bytes() - 1;
    const Outcome less = run(caller, options);
    interposed().most_allocation_bytes = UINT64_MAX;
    EXPECT_EQ(whole.tiles, 1u);
    EXPECT_GT(less.tiles, 1u) << less.error;
    EXPECT_TRUE(contains(less.shortage, "MiB for activations on " + device->info().name)) << less.shortage;
    FuserOptions limited = options;
    limited.max_memory_bytes = plan_fusion(model_, 12, 40, device->info(), options).peak_bytes() / 4 * 3;
    const Outcome asked = run(caller, limited);
    EXPECT_EQ(asked.shortage, "");
    EXPECT_EQ(less.tiles, asked.tiles);
    EXPECT_TRUE(same_bits(less.values, asked.values));
  }
}

TEST_F(FaultsTest, TilesBecomeSmallerInAFrame) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  Fuser fuser(*device, model_, 12, 40, {}, cache());
  EXPECT_EQ(fuser.plan().tiling.count(), 1u);
  interposed().most_allocation_bytes = frame_bytes(frame_shapes(model_, fuser.plan().tiling.tile)[2]) - 1;
  const std::vector<float> values = fuse(fuser);
  EXPECT_GT(fuser.plan().tiling.count(), 1u);
  EXPECT_TRUE(contains(fuser.shortage(), "for hrls")) << fuser.shortage();
  interposed().most_allocation_bytes = UINT64_MAX;
  EXPECT_TRUE(same_bits(values, run(caller, {}).values));

  // The tiles stay while a recording may be pending.
  const FrameImage lrhs(*device, subject_.lrhs), hrls(*device, subject_.hrls);
  const FrameImage fused(*device, Shape{24, 80, 3});
  Fuser recorded(*device, model_, 12, 40, {}, cache());
  Commands pool(*device);
  recorded.record(pool.begin("frame"), lrhs.view(), hrls.view(), fused.view());
  interposed().most_allocation_bytes = 1;
  EXPECT_THROW(fuse(recorded), OutOfMemory);
  EXPECT_EQ(recorded.plan().tiling.count(), 1u);
}

// Winograd gives other bits with other tiles, so that no pixel of the last frame may be reused.
TEST_F(FaultsTest, SmallerTilesTakeNothingOfTheLastFrame) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  Fuser fuser(*device, model_, 12, 40, {.skip_unchanged = true}, cache());
  Image fused;
  const Image hrls = image_of(subject_.hrls), other = image_of(subject_.lrhs);
  for (const size_t sequence : {0, 1}) fuser.fuse(other, hrls, fused, {}, 0, sequence);
  subject_.lrhs.at(0, 0, 0) += 1;
  interposed().fault = {.function = "vkWaitForFences", .call = 1, .code = VK_ERROR_OUT_OF_DEVICE_MEMORY};
  const FuseReport report = fuser.fuse(image_of(subject_.lrhs), hrls, fused);
  interposed().fault = {};
  EXPECT_GT(fuser.plan().tiling.count(), 1u);
  EXPECT_EQ(report.skipped_share, 0);
  EXPECT_TRUE(same_bits(fused.data, run(caller, {}).values));
  EXPECT_EQ(fuser.fuse(other, hrls, fused, {}, 0, 1).skipped_share, 0);  // another sequence's last frame
}

// A frame that starts again has already written some of what the next one goes on with.
TEST_F(FaultsTest, SmallerTilesGoOnWithTheLastFrame) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Model model(golden_model_path("pyramid-x1"));
  constexpr int kHeight = 16, kWidth = 659;
  const FuserOptions options{.temporal = true,
                             .compute_variance = true,
                             .samples = {.hrls = 1},
                             .exposure = 0.5f,
                             .work_limits = all_.work_limits};
  Fuser fuser(*device, model, kHeight, kWidth, options, cache());
  Fuser other(*device, model, kHeight, kWidth, options, cache());
  const auto image = [](int channels, uint64_t seed) {
    return floats(random_planes(channels, kHeight, kWidth, Fill::kUniform, seed));
  };
  int submits = 0;
  for (const uint64_t frame : {1, 2, 3}) {
    const std::vector<float> hrls = image(9, frame), motion = image(2, 10 + frame);
    std::vector<float> values(size_t{3} * kHeight * kWidth), expected(values.size());
    // The last submit fails, when all layers that write to the history have run.
    if (frame == 2)
      interposed().fault = {
          .function = "vkQueueSubmit", .call = submits, .code = VK_ERROR_OUT_OF_DEVICE_MEMORY};
    interposed().failures = 0;
    interposed().calls.clear();
    EXPECT_EQ(fuser.plan().tiling.count() == 1, frame <= 2);
    fuser.fuse(nullptr, hrls.data(), values.data(), {}, 0, 0, motion.data());
    EXPECT_EQ(interposed().failures, frame == 2 ? 1 : 0);
    interposed().fault = {};
    submits = interposed().calls["vkQueueSubmit"] - 1;  // the first frame's history is filled by another one
    other.fuse(nullptr, hrls.data(), expected.data(), {}, 0, 0, motion.data());
    EXPECT_TRUE(same_bits(values, expected)) << "frame " << frame;
  }
}

TEST_F(FaultsTest, AHistoryThatCannotBeLoadedLeavesTheLastOne) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  const Model model(golden_model_path("pyramid-x1"));
  const FuserOptions options{
      .temporal = true, .compute_variance = true, .samples = {.hrls = 1}, .exposure = 0.5f};
  Fuser fuser(*device, model, 8, 8, options, cache());
  const auto saved_after = [&](uint64_t seed) {
    const std::vector<float> hrls = floats(random_planes(9, 8, 8, Fill::kUniform, seed)), motion(2 * 8 * 8);
    std::vector<float> fused(3 * 8 * 8);
    fuser.fuse(nullptr, hrls.data(), fused.data(), {}, 0, 0, motion.data());
    std::vector<std::byte> saved(fuser.saved_history_bytes());
    fuser.save_history(saved);
    return saved;
  };
  const std::vector<std::byte> first = saved_after(1), second = saved_after(2);
  ASSERT_NE(first, second);
  std::vector<std::byte> now(first.size());
  for (const char* function : {"vkAllocateMemory", "vkQueueSubmit", "vkWaitForFences"}) {
    interposed().fault = {.function = function, .call = 1, .code = VK_ERROR_OUT_OF_DEVICE_MEMORY};
    EXPECT_THROW(fuser.load_history(first), OutOfMemory) << function;
    interposed().fault = {};
    fuser.save_history(now);
    EXPECT_EQ(now, second) << function;
  }
  fuser.load_history(first);
  fuser.save_history(now);
  EXPECT_EQ(now, first);
}

TEST_F(FaultsTest, NoMemoryAtAllIsAnErrorThatSaysHowMuchWasAsked) {
  CallerDevice caller;
  const std::unique_ptr<Device> device = Device::wrap(caller.external());
  for (int allocation = 1; allocation <= 7; ++allocation) {
    interposed().fault = {"vkAllocateMemory", allocation, VK_ERROR_OUT_OF_DEVICE_MEMORY, true};
    const std::string error = run(caller, {}).error;
    for (const char* part : {"allocating ", "VK_ERROR_OUT_OF_DEVICE_MEMORY", "MiB in all",
                             "the smallest tile does not fit", "another device"})
      EXPECT_TRUE(contains(error, part)) << error << "\nlacks " << part;
  }
  interposed().fault = {};
  EXPECT_EQ(run(caller, {}).error, "");
}

}  // namespace
}  // namespace raymeld::test
