#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <span>
#include <string>

#include "conform/conform.h"
#include "conform/frame_image.h"
#include "conform/layer_run.h"
#include "support.h"

// Shares a device, its pipelines and a writer of model files among the tests that run on a device.
namespace raymeld::test {

using conform::frame_layouts;
using conform::FrameImage;
using conform::kPrecisions;
using conform::name_of;
using conform::run_passes;
using conform::storage_of;

// Returns what the tests validate: usual checks and synchronization. RAYMELD_TEST_VALIDATION=0 is for
// machines that have a device but no validation layers. The value gpu-assisted checks the accesses of
// shaders.
Validation asked_validation();

// Returns the device that all tests of a process share, with validation and synchronization validation.
const Device& gpu();

// Fails a test during which the validation layers reported anything.
class GpuTest : public testing::Test {
 protected:
  void SetUp() override { gpu(); }
  void TearDown() override;
};

// Returns success when all values have the same bits or are NaN on both sides.
testing::AssertionResult same_bits(std::span<const float> actual, std::span<const float> expected);

// Serves as conform::Options::on_finding. Fails the test on a failed case, or an unsupported one without
// reason.
void expect_passed(const conform::Finding& finding);

// Returns the cache of compiled pipelines that the tests of a process share, in a temporary folder.
PipelineCache& shared_cache();
std::filesystem::path shared_cache_folder();
// Returns the shared device with this cache and its folder.
const conform::Target& target();

// See conform::model_file().
void write_model(const std::filesystem::path& path, const reference::Architecture& architecture,
                 const reference::Weights& weights, const std::map<std::string, std::string>& other = {});

}  // namespace raymeld::test
