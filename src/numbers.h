#pragma once

#include <cstdint>

namespace raymeld {

inline constexpr double kMebibyte = 1048576;

constexpr uint32_t divide_up(uint32_t a, uint32_t b) { return (a + b - 1) / b; }

// Rounds towards minus infinity; `divisor` must be positive.
constexpr int divide_down(int value, int divisor) { return value / divisor - (value % divisor < 0 ? 1 : 0); }

}  // namespace raymeld
