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

// What the tests on a device share: the device, its pipelines, model files.
namespace raymeld::test {

using conform::frame_layouts;
using conform::FrameImage;
using conform::kPrecisions;
using conform::name_of;
using conform::run_passes;
using conform::storage_of;

// One device for all tests of a process, with validation and synchronization validation.
const Device& gpu();

// Fails a test during which the validation layers had something to say.
class GpuTest : public testing::Test {
 protected:
  void SetUp() override { gpu(); }
  void TearDown() override;
};

// The same bits, or NaN for NaN.
testing::AssertionResult same_bits(std::span<const float> actual, std::span<const float> expected);

// For conform::Options: a failed case is a failure, and one that is unsupported without reason.
void expect_passed(const conform::Finding& finding);

// One cache of compiled pipelines for the tests of a process, in a folder that goes with it.
PipelineCache& shared_cache();
std::filesystem::path shared_cache_folder();
// The device and these.
const conform::Target& target();

// See conform::model_file().
void write_model(const std::filesystem::path& path, const reference::Architecture& architecture,
                 const reference::Weights& weights, const std::map<std::string, std::string>& other = {});

}  // namespace raymeld::test
