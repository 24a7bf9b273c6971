#pragma once

#include "fusion/plan.h"

namespace raymeld::test {

// All ways of computing convolutions that the device has but matrices, in both precisions; each in one of
// them unless at full extent.
std::vector<FuserOptions> all_options();
std::string describe(const FuserOptions& options);

}  // namespace raymeld::test
