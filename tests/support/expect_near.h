// Compares a layer's result with values that were computed by hand.
#pragma once

#include <gtest/gtest.h>

#include <vector>

#include "reference/reference.h"

namespace raymeld::test {

inline void expect_near(const reference::Planes& actual, const std::vector<double>& expected) {
  ASSERT_EQ(actual.data.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(actual.data[i], expected[i], 1e-12) << i;
}

inline void expect_near(const reference::Bounded& actual, const std::vector<double>& expected) {
  expect_near(actual.value, expected);
}

}  // namespace raymeld::test
