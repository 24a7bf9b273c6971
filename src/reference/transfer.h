#pragma once

#include "reference/interval.h"
#include "reference/reference.h"

// Defines the transfer function and its inverse, for double and for Interval.
namespace raymeld::reference {

inline constexpr double kLargestOutput = 65504;

template <typename T>
T apply(Transfer transfer, const T& x) {
  using std::log;
  if (transfer == Transfer::kLinear) return x;
  return log(1 + 8 * x) / 3;
}

// The exponent is limited to 80, so that exp stays finite in fp32. Larger results are clamped later anyway.
template <typename T>
T invert(Transfer transfer, const T& y) {
  using std::exp, std::min;
  if (transfer == Transfer::kLinear) return y;
  return (exp(min(3 * y, T(80))) - 1) / 8;
}

}  // namespace raymeld::reference
