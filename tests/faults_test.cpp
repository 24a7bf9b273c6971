// Any call of Vulkan may fail: then an error says what was being done, nothing is left behind, and the next
// frame is right.
#include "faults.h"

#include <gtest/gtest.h>

#include <regex>

#include "caller_device.h"
#include "error_of.h"
#include "fuser.h"
#include "subject.h"

namespace raymeld::test {
namespace {

using Calls = std::map<std::string, int>;

// What comes of a frame: an error, or values.
struct Outcome {
  std::string error, shortage;
  std::vector<float> values;
  uint32_t tiles = 0;
};

class FaultsTest : public testing::Test {
 protected:
  FaultsTest() { write_model(folder_ / "model.safetensors", subject_.architecture, subject_.weights); }

  std::vector<float> fuse(Fuser& fuser) const {
    Image fused;
    fuser.fuse(image_of(subject_.lrhs), image_of(subject_.hrls), fused);
    return fused.data;
  }

  // All of a frame, from wrapping the device to letting everything go.
  Outcome run(const CallerDevice& caller, const FuserOptions& options) const {
    Outcome outcome;
    try {
      const std::unique_ptr<Device> device = Device::wrap(caller.external());
      Fuser fuser(*device, model_, 12, 40, options, cache());
      outcome.values = fuse(fuser);
      // Copies of a layer are commands of another kind than a frame's.
      if (options.keep_activations) fuser.program().read(*fuser.graph().layers().front()->output());
      outcome.shortage = fuser.shortage();
      outcome.tiles = fuser.plan().tiling.count();
    } catch (const Error& error) {
      outcome.error = error.what();
    }
    return outcome;
  }

  std::filesystem::path cache() const { return folder_ / "cache"; }
  uint64_t peak_bytes(const DeviceInfo& device, const FuserOptions& options) const {
    return plan_fusion(model_, 12, 40, device, options).peak_bytes();
  }

  int check_every_call(VkResult code, const FuserOptions& options);

  TemporaryDirectory folder_;
  Subject subject_ = make_subject(small_architecture(2), 12, 40, 1);
  Model model_ = (write_model(folder_ / "model.safetensors", subject_.architecture, subject_.weights),
                  Model(folder_ / "model.safetensors"));
  // Several submits, and every kind of call.
  const FuserOptions all_{.profile = true, .work_limits = WorkLimits{1e5, 3e5}};
};

// Before there is a tile that could be smaller.
bool comes_before_tiles(const std::string& function) {
  return function == "vkEnumerateDeviceExtensionProperties" || function == "vkCreateFence" ||
         function == "vkCreatePipelineCache" ||
         function == "vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR";
}

// A frame for which less memory may do is made again; a cache on disk is not needed.
bool is_survived(const std::string& function, VkResult code, const FuserOptions& options) {
  if (function == "vkGetPipelineCacheData") return true;
  const bool out_of_memory = code == VK_ERROR_OUT_OF_DEVICE_MEMORY ||
                             (code == VK_ERROR_OUT_OF_HOST_MEMORY && function == "vkAllocateMemory");
  return out_of_memory && !comes_before_tiles(function) && !options.keep_activations;
}

// Returns how many calls there are that may return `code`.
int FaultsTest::check_every_call(VkResult code, const FuserOptions& options) {
  const bool lost = code == VK_ERROR_DEVICE_LOST;
  auto caller = std::make_unique<CallerDevice>();
  const Outcome sound = run(*caller, options);
  EXPECT_EQ(sound.error, "");
  for (int call = 1;; ++call) {
    interposed().fault = {.call = call, .code = code};
    interposed().failures = 0;
    const Outcome outcome = run(*caller, options);
    interposed().fault = {};
    if (interposed().failures == 0) return call - 1;
    const std::string failed = interposed().failed;
    SCOPED_TRACE(fmt::format("call {}, {}: {}", call, failed, result_name(code)));
    EXPECT_EQ(interposed().alive, Calls{});
    if (is_survived(failed, code, options)) {
      EXPECT_EQ(outcome.error, "");
      EXPECT_TRUE(same_bits(outcome.values, sound.values));
      EXPECT_EQ(outcome.tiles > sound.tiles, !outcome.shortage.empty());
      EXPECT_EQ(outcome.tiles > sound.tiles, failed != "vkGetPipelineCacheData");
    } else {
      const std::regex doing("^[a-z]+ing [^:]+: " + result_name(code) + "(.|\n)*");
      EXPECT_TRUE(std::regex_match(outcome.error, doing)) << outcome.error;
      if (lost) EXPECT_TRUE(contains(outcome.error, "llvmpipe")) << outcome.error;
    }
    if (lost) caller = std::make_unique<CallerDevice>();
    if (call % 8 == 0 || lost) {
      const Outcome next = run(*caller, options);
      EXPECT_EQ(next.error, "");
      EXPECT_TRUE(same_bits(next.values, sound.values));
    }
    if (HasFailure()) return call;
  }
}

TEST_F(FaultsTest, OutOfHostMemory) {
  const int calls = check_every_call(VK_ERROR_OUT_OF_HOST_MEMORY, all_);
  EXPECT_GT(calls, 100);
  RecordProperty("calls", calls);
  fmt::print("{} calls\n", calls);
}

TEST_F(FaultsTest, OutOfDeviceMemory) {
  const int calls = check_every_call(VK_ERROR_OUT_OF_DEVICE_MEMORY, all_);
  EXPECT_GT(calls, 100);
  fmt::print("{} calls\n", calls);
}

TEST_F(FaultsTest, DeviceLost) {
  const int calls = check_every_call(VK_ERROR_DEVICE_LOST, all_);
  EXPECT_GT(calls, 6);
  fmt::print("{} calls\n", calls);
}

}  // namespace
}  // namespace raymeld::test
