#include "gpu.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <vector>

#include "conform/collector.h"
#include "conform/model_file.h"

namespace raymeld::test {

namespace {

// RAYMELD_TEST_VALIDATION=0 is for machines that have a device but no layers, gpu-assisted for accesses of
// shaders.
Validation wished_validation() {
  const char* value = std::getenv("RAYMELD_TEST_VALIDATION");
  const std::string wish = value ? value : "";
  if (wish == "0") return Validation::kNone;
  if (wish == "gpu-assisted") return Validation::kGpuAssisted;
  if (!wish.empty()) throw Error("RAYMELD_TEST_VALIDATION is '{}', expected 0 or gpu-assisted", wish);
  return Validation::kSynchronization;
}

}  // namespace

const Device& gpu() {
  static const std::unique_ptr<Device> device =
      Device::create({.selector = {}, .validation = wished_validation()});
  return *device;
}

void GpuTest::TearDown() {
  static size_t seen = 0;
  const std::vector<std::string>& messages = gpu().messages();
  for (; seen < messages.size(); ++seen) ADD_FAILURE() << messages[seen];
}

testing::AssertionResult same_bits(std::span<const float> actual, std::span<const float> expected) {
  if (actual.size() != expected.size()) {
    return testing::AssertionFailure() << actual.size() << " values, expected " << expected.size();
  }
  for (size_t i = 0; i < actual.size(); ++i) {
    const bool same = std::bit_cast<uint32_t>(actual[i]) == std::bit_cast<uint32_t>(expected[i]);
    if (same || (std::isnan(actual[i]) && std::isnan(expected[i]))) continue;
    return testing::AssertionFailure()
           << fmt::format("value {} of {} is {:a}, expected {:a}", i, actual.size(), actual[i], expected[i]);
  }
  return testing::AssertionSuccess();
}

void expect_passed(const conform::Finding& finding) {
  const auto& [layer, kernel, precision, shape] = finding.of;
  const std::string what = fmt::format("{}, {}, {}, {}", layer, kernel, name_of(precision), shape);
  if (finding.outcome == conform::Outcome::kUnsupported) {
    const DeviceInfo& device = gpu().info();
    const std::map<std::string, bool> lacks{
        {"16-bit storage", !device.storage_16bit},
        {"buffer device address", !device.buffer_device_address},
        {"cooperative matrix", !is_possible(conform::matrix_tiles(device, 3).front(), 3)}};
    const auto feature = lacks.find(finding.message);
    EXPECT_TRUE(feature != lacks.end() && feature->second) << what << ": unsupported: " << finding.message;
    return;
  }
  EXPECT_EQ(finding.outcome, conform::Outcome::kPassed) << what << ": " << finding.message;
}

std::filesystem::path shared_cache_folder() {
  gpu();  // outlives the folder
  static const TemporaryDirectory folder;
  return folder.path();
}

PipelineCache& shared_cache() {
  static PipelineCache cache(gpu(), shared_cache_folder());
  return cache;
}

const conform::Target& target() {
  static const conform::Target all{gpu(), shared_cache(), shared_cache_folder()};
  return all;
}

void write_model(const std::filesystem::path& path, const reference::Architecture& architecture,
                 const reference::Weights& weights, const std::map<std::string, std::string>& other) {
  write_safetensors(path, conform::model_file(architecture, weights, other));
}

}  // namespace raymeld::test
