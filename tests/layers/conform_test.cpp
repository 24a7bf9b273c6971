#include "conform/conform.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "conform/collector.h"
#include "conform/conv2d_trials.h"
#include "conform/network.h"
#include "conform/report.h"
#include "conform/values.h"
#include "error_of.h"
#include "gpu.h"

namespace raymeld::test {
namespace {

using conform::Check;
using conform::Collector;
using conform::Finding;
using conform::Outcome;
using conform::Suite;
using reference::exact;
using reference::Planes;
using reference::Precision;

class ConformTest : public GpuTest, public testing::WithParamInterface<Suite> {};

TEST_P(ConformTest, Passes) {
  std::map<std::string, double> worst;
  const std::set<std::string> layers = layer_names();
  size_t passed = 0;
  const conform::Options options{
      .extent = full_extent() ? conform::Extent::kFull : conform::Extent::kQuick,
      .on_finding = [&](const Finding& finding) {
        expect_passed(finding);
        passed += finding.outcome == Outcome::kPassed;
        const auto& [layer, kernel, precision, shape] = finding.of;
        if (GetParam().name != std::string("network")) {
          EXPECT_TRUE(layers.contains(layer.substr(0, layer.find(' ')))) << layer << " is no layer";
        }
        double& kept = worst[fmt::format("{} {} {}", layer, kernel, name_of(precision))];
        kept = std::max(kept, finding.worst.ratio);
        if (finding.rms_ratio == 0) return;
        double& kept_rms = worst["RMS " + fmt::format("{} {} {}", layer, kernel, name_of(precision))];
        kept_rms = std::max(kept_rms, finding.rms_ratio);
      }};
  conform::conform(GetParam(), target(), options);
  EXPECT_GT(passed, 0u);
  for (const auto& [name, ratio] : worst) RecordProperty("worst_ratio " + name, fmt::format("{:.3g}", ratio));
}

INSTANTIATE_TEST_SUITE_P(Suites, ConformTest,
                         testing::ValuesIn(conform::suites().begin(), conform::suites().end()),
                         [](const auto& info) { return info.param.name; });

class CollectorTest : public GpuTest {
 protected:
  // Runs one case and returns its finding.
  Finding finding(const std::function<void(Check&)>& body,
                  const conform::Method& method = {.name = "direct"}) {
    std::vector<Finding> findings;
    const conform::Options options{.on_finding = [&](const Finding& f) { findings.push_back(f); }};
    Collector(target(), options).run("layer", method, Precision::kFp32, "shape", body);
    EXPECT_EQ(findings.size(), 1u);
    return findings.at(0);
  }
};

TEST_F(CollectorTest, FailsWhereAValueIsBeyondItsBound) {
  const Planes device(1, 1, 3, {1, 2.25, 3});
  reference::Bounded expected{Planes(1, 1, 3, {1, 2, 3}), Planes(1, 1, 3, {0, 0.5, 0})};
  const Finding passed = finding([&](Check& check) { check.within(device, expected, "it"); });
  EXPECT_EQ(passed.outcome, Outcome::kPassed);
  EXPECT_EQ(passed.worst.ratio, 0.5);
  EXPECT_EQ(passed.worst.x, 1);
  EXPECT_EQ(passed.values, 3u);

  expected.bound.data[1] = 0.125;
  const Finding failed = finding([&](Check& check) {
    check.within(device, expected, "first");
    check.within(device, exact(device), "second");
  });
  EXPECT_EQ(failed.outcome, Outcome::kFailed);
  EXPECT_EQ(failed.worst.ratio, 2);
  EXPECT_EQ(failed.where, "first");
  EXPECT_NE(failed.message.find("first: worst error / bound 2 at c 0, y 0, x 1"), std::string::npos)
      << failed.message;
}

TEST_F(CollectorTest, FailsWhereTheRmsErrorIsBeyondWhatIsAllowed) {
  const Planes device(1, 1, 4, {1, 2, 3, 5}), truth(1, 1, 4, {1, 2, 3, 4});  // the RMS error is 0.5
  EXPECT_EQ(finding([&](Check& check) { check.rms(device, truth, 0.51, "it"); }).outcome, Outcome::kPassed);
  const Finding failed = finding([&](Check& check) { check.rms(device, truth, 0.25, "it"); });
  EXPECT_EQ(failed.outcome, Outcome::kFailed);
  EXPECT_NE(failed.message.find("it: "), std::string::npos) << failed.message;
}

TEST_F(CollectorTest, BitsAreMoreThanValues) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const auto compare = [&](double a, double b) {
    return finding([&](Check& check) { check.same_bits(Planes(1, 1, 1, {a}), Planes(1, 1, 1, {b})); })
        .outcome;
  };
  EXPECT_EQ(compare(kNaN, -kNaN), Outcome::kPassed);
  EXPECT_EQ(compare(-0.0, -0.0), Outcome::kPassed);
  EXPECT_EQ(compare(0.0, -0.0), Outcome::kFailed);
  EXPECT_EQ(compare(1.0, kNaN), Outcome::kFailed);
}

TEST_F(CollectorTest, AnExceptionOrNothingComparedIsAFailure) {
  const Finding thrown = finding([](Check&) { throw Error("the device is gone"); });
  EXPECT_EQ(thrown.outcome, Outcome::kFailed);
  EXPECT_NE(thrown.message.find("the device is gone"), std::string::npos);
  EXPECT_EQ(finding([](Check&) {}).outcome, Outcome::kFailed);
  EXPECT_EQ(finding([](Check& check) { check.that(false, "no"); }).outcome, Outcome::kFailed);
}

TEST_F(CollectorTest, WhatADeviceLacksIsNotTried) {
  const conform::Method matrices{.name = "matrices", .kernel = {.algorithm = Algorithm::kMatrix}};
  const Finding result = finding([](Check&) { FAIL() << "tried"; }, matrices);
  EXPECT_EQ(result.outcome, Outcome::kUnsupported);
  EXPECT_EQ(result.message, "cooperative matrix");
}

// A device on which no case could be tried does not conform.
TEST(Report, ComplainsOfFailuresAndWhereNothingPassed) {
  using conform::Report;
  const auto layer = [](const char* name) {
    return conform::Case{.layer = name, .kernel = "", .precision = reference::Precision::kFp32, .shape = ""};
  };
  Report report;
  EXPECT_NE(report.complaint().find("no case passed"), std::string::npos);
  report.add({.of = layer("a"), .outcome = Outcome::kUnsupported, .message = "16-bit storage"});
  report.add({.of = layer("b"), .outcome = Outcome::kUnsupported, .message = "cooperative matrix"});
  report.add({.of = layer("b"), .outcome = Outcome::kUnsupported, .message = "cooperative matrix"});
  EXPECT_EQ(report.complaint(), "no case passed: 3 are unsupported (16-bit storage, cooperative matrix)");
  report.add({.of = layer("c")});
  EXPECT_EQ(report.complaint(), "");
  report.add({.of = layer("d"), .outcome = Outcome::kFailed});
  EXPECT_EQ(report.complaint(), "1 of the device's cases failed");
}

// Only tiles that the shader can make of a device's matrices are tried.
TEST(Methods, AreOfPossibleTilesOfMatrices) {
  DeviceInfo device;
  const auto tiles = [&](std::optional<CooperativeMatrix> matrix, uint32_t kernel,
                         conform::Extent extent = conform::Extent::kQuick) {
    device.cooperative_matrix = matrix;
    std::vector<MatrixTiles> found;
    for (const conform::Method& method : conform::conv2d_methods(device, kernel, extent))
      if (method.kernel.algorithm == Algorithm::kMatrix) found.push_back(method.kernel.matrix);
    return found;
  };
  const CooperativeMatrix matrix{
      .m = 16, .n = 16, .k = 16, .subgroup_size = 32, .max_invocations = 1024, .max_shared_bytes = 49152};
  const CooperativeMatrix wide{
      .m = 16, .n = 64, .k = 16, .subgroup_size = 32, .max_invocations = 1024, .max_shared_bytes = 49152};
  const CooperativeMatrix deep{
      .m = 16, .n = 16, .k = 32, .subgroup_size = 32, .max_invocations = 1024, .max_shared_bytes = 32768};
  for (const uint32_t kernel : {1u, 3u}) {
    const std::vector<MatrixTiles> both = tiles(matrix, kernel);
    ASSERT_EQ(both.size(), 2u);
    for (const MatrixTiles& one : both) EXPECT_TRUE(is_possible(one, kernel));
    EXPECT_EQ(tiles({}, kernel), std::vector{MatrixTiles{}});
    EXPECT_EQ(tiles(wide, kernel), std::vector{MatrixTiles{}});
  }
  EXPECT_EQ(tiles(deep, 1).size(), 2u);
  const MatrixTiles smaller{.matrix = deep, .outputs = 16, .rows = 1, .subgroups = 2, .channels = 32};
  EXPECT_EQ(tiles(deep, 3), std::vector{smaller});  // the other takes 56 KiB
  EXPECT_TRUE(is_possible(conform::network_methods(device, 0).back().kernel.matrix, 3));
  device.type = "CPU";
  EXPECT_EQ(tiles(matrix, 1).size(), 2u);
  EXPECT_EQ(tiles(matrix, 3).size(), 1u);
  EXPECT_EQ(tiles(matrix, 3, conform::Extent::kFull).size(), 2u);
  device.cooperative_matrix = wide;
  EXPECT_FALSE(is_possible(conform::network_methods(device, 0).back().kernel.matrix, 1));
}

class AgreementTest : public GpuTest {
 protected:
  // Runs a network on a single pixel and returns the findings by layer.
  std::map<std::string, Finding> run(const std::vector<conform::Values>& others,
                                     conform::Values* keep = nullptr) {
    std::map<std::string, Finding> findings;
    const conform::Options options{
        .others = others, .keep = keep, .on_finding = [&](const Finding& f) { findings[f.of.layer] = f; }};
    const conform::Subject subject = conform::make_subject({.scale = 2,
                                                            .features = 1,
                                                            .growth = 1,
                                                            .dense_layers = 1,
                                                            .blocks = 1,
                                                            .groups = 1,
                                                            .hrls_layers = {reference::LayerKind::kRadiance},
                                                            .clip = 100},
                                                           1, 1, 1);
    conform::conform_one(Collector(target(), options), "net", subject, {.method = {.name = "direct"}});
    return findings;
  }
};

// A device agrees with itself; other values fail, and missing values count as unsupported.
TEST_F(AgreementTest, IsOfTheSameNetworksWithinBothBounds) {
  conform::Values own{.device = "itself"};
  EXPECT_FALSE(run({}, &own).contains("agreement with itself"));
  ASSERT_EQ(own.outputs.size(), 1u);
  ASSERT_TRUE(own.outputs.contains("net, direct, fp32"));
  conform::Values off{"another", own.outputs};
  off.outputs.begin()->second.data[2] += 1;
  const std::map<std::string, Finding> findings = run({own, off, {"a third"}});
  EXPECT_EQ(findings.at("agreement with itself").outcome, Outcome::kPassed);
  EXPECT_EQ(findings.at("agreement with another").outcome, Outcome::kFailed);
  EXPECT_EQ(findings.at("agreement with another").worst.x, 0);
  EXPECT_EQ(findings.at("agreement with another").worst.y, 1);
  EXPECT_EQ(findings.at("agreement with a third").outcome, Outcome::kUnsupported);
}

TEST(Values, AreReadAsTheyWereWritten) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const TemporaryDirectory folder;
  const std::filesystem::path file = folder / "values";
  const Planes output(1, 2, 3, {0.1, -0.0, 65504, kInfinity, -kInfinity, 0x1p-149});
  const Planes nan(1, 1, 1, {std::numeric_limits<double>::quiet_NaN()});
  conform::write_values(file, {"a device", {{"net", output}, {"nan", nan}}});
  const conform::Values read = conform::read_values(file);
  EXPECT_EQ(read.device, "a device");
  EXPECT_EQ(read.outputs.at("net").data, output.data);
  EXPECT_EQ(read.outputs.at("net").h, 2);
  EXPECT_TRUE(std::isnan(read.outputs.at("nan").data.at(0)));
  for (const char* bad :
       {"", "{}", R"({"device": "a", "outputs": {"net": {"shape": [1, 1, 1], "values": [null]}}})",
        R"({"device": "a", "outputs": {"net": {"shape": [1, 1, 1], "values": ["much"]}}})"}) {
    write_file(file, bad);
    const std::string error = error_of([&] { conform::read_values(file); });
    EXPECT_NE(error.find("is no file of raymeld conform --values"), std::string::npos)
        << bad << ": " << error;
    EXPECT_NE(error.find(file.string()), std::string::npos) << error;
  }
}

}  // namespace
}  // namespace raymeld::test
