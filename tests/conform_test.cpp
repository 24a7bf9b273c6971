#include "conform/conform.h"

#include <gtest/gtest.h>

#include <limits>

#include "conform/collector.h"
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

TEST_P(ConformTest, PassesInFull) {
  std::map<std::string, double> worst;
  size_t passed = 0;
  const conform::Options options{.on_finding = [&](const Finding& finding) {
    expect_passed(finding);
    passed += finding.outcome == Outcome::kPassed;
    const auto& [layer, kernel, precision, shape] = finding.of;
    double& kept = worst[fmt::format("{} {} {}", layer, kernel, name_of(precision))];
    kept = std::max(kept, finding.worst.ratio);
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
  // What comes of a case.
  Finding finding(const std::function<void(Check&)>& body, const conform::Way& way = {.name = "direct"}) {
    std::vector<Finding> findings;
    const conform::Options options{.on_finding = [&](const Finding& f) { findings.push_back(f); }};
    Collector(target(), options).run("layer", way, Precision::kFp32, "shape", body);
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
  const conform::Way matrices{.name = "matrices", .kernel = {.matrix = MatrixTiles{}}};
  bool tried = false;
  const Finding result = finding([&](Check&) { tried = true; }, matrices);
  EXPECT_EQ(tried, gpu().info().cooperative_matrix.has_value());
  EXPECT_EQ(result.outcome, tried ? Outcome::kFailed : Outcome::kUnsupported);
  EXPECT_EQ(result.message, tried ? "nothing was compared" : "cooperative matrix");
}

}  // namespace
}  // namespace raymeld::test
