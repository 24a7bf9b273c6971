#pragma once

#include <gtest/gtest.h>

#include <string_view>

#include "reference/bounds.h"

namespace raymeld::test {

// Returns whether all values lie within their bounds. Both outcomes name the worst place, and the test's XML
// records the largest ratio of each layer.
testing::AssertionResult within_bounds(std::string_view layer, const reference::Planes& actual,
                                       const reference::Bounded& expected);

}  // namespace raymeld::test
