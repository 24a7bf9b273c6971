#include "within_bounds.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <string>
#include <utility>

namespace raymeld::test {
namespace {

// Keeps the largest ratio of each test and layer.
void record(std::string_view layer, double ratio) {
  static std::map<std::pair<const testing::TestInfo*, std::string>, double> largest;
  double& kept = largest[{testing::UnitTest::GetInstance()->current_test_info(), std::string(layer)}];
  kept = std::max(kept, ratio);
  testing::Test::RecordProperty(fmt::format("worst_ratio_{}", layer), fmt::format("{:.3g}", kept));
}

}  // namespace

testing::AssertionResult within_bounds(std::string_view layer, const reference::Planes& actual,
                                       const reference::Bounded& expected) {
  const reference::Worst at = worst(actual, expected);
  const bool passed = at.ratio <= 1;
  testing::AssertionResult result = passed ? testing::AssertionSuccess() : testing::AssertionFailure();
  record(layer, at.ratio);
  return result << fmt::format("{} ({} x {} x {}): {}", layer, actual.c, actual.h, actual.w,
                               text_of(at, actual.data.size()));
}

}  // namespace raymeld::test
