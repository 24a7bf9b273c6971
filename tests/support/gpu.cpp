#include "gpu.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <optional>
#include <vector>

#include "conform/collector.h"
#include "conform/model_file.h"
#include "engine/kernel_pool.h"

namespace raymeld::test {

Validation asked_validation() {
  const char* value = std::getenv("RAYMELD_TEST_VALIDATION");
  const std::string asked = value ? value : "";
  if (asked == "0") return Validation::kNone;
  if (asked == "gpu-assisted") return Validation::kGpuAssisted;
  if (!asked.empty()) throw Error("RAYMELD_TEST_VALIDATION is '{}', expected 0 or gpu-assisted", asked);
  return Validation::kSynchronization;
}

namespace {

// Holds the objects that the tests of a process share, each made at its first use. All are destroyed after
// the tests, and messages of the validation layers about that fail the run too.
class SharedDevice : public testing::Environment {
 public:
  const Device& device() {
    const auto keep = [this](const std::string& message) { messages_.push_back(message); };
    if (device_) return *device_;
    device_ = Device::create({.selector = {}, .validation = asked_validation(), .on_message = keep});
    device_->kernels().keep(1000);
    return *device_;
  }
  PipelineCache& cache() {
    if (!cache_) cache_.emplace(device(), folder_.path());
    return *cache_;
  }
  const std::filesystem::path& folder() const { return folder_.path(); }
  const conform::Target& target() {
    if (!target_) target_.emplace(conform::Target{device(), cache(), folder()});
    return *target_;
  }

  void fail_on_messages() {
    for (const std::string& message : messages_) ADD_FAILURE() << message;
    messages_.clear();
  }

  void TearDown() override {
    target_.reset();
    cache_.reset();
    device_.reset();
    fail_on_messages();
  }

 private:
  std::vector<std::string> messages_;
  TemporaryDirectory folder_;
  std::unique_ptr<Device> device_;
  std::optional<PipelineCache> cache_;
  std::optional<conform::Target> target_;
};

// GoogleTest deletes it.
SharedDevice& shared = *static_cast<SharedDevice*>(testing::AddGlobalTestEnvironment(new SharedDevice));

}  // namespace

const Device& gpu() { return shared.device(); }

void GpuTest::TearDown() { shared.fail_on_messages(); }

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

std::filesystem::path shared_cache_folder() { return shared.folder(); }

PipelineCache& shared_cache() { return shared.cache(); }

const conform::Target& target() { return shared.target(); }

void write_model(const std::filesystem::path& path, const reference::Architecture& architecture,
                 const reference::Weights& weights, const std::map<std::string, std::string>& other) {
  write_safetensors(path, conform::model_file(architecture, weights, other));
}

}  // namespace raymeld::test
