#pragma once

#include "engine/cooperative_matrix.h"

namespace raymeld::test {

// GPUs have this matrix, and so have the tunings in tests/fuzz/corpus.
constexpr CooperativeMatrix kMatrix{.m = 16,
                                    .n = 16,
                                    .k = 16,
                                    .subgroup_size = 32,
                                    .requires_size = true,
                                    .max_invocations = 1024,
                                    .max_shared_bytes = 49152};

}  // namespace raymeld::test
