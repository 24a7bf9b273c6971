#pragma once

#include "reference/interval.h"
#include "reference/reference.h"

// The transfer function and its inverse, for double and for Interval.
namespace raymeld::reference {

inline constexpr double kLargestOutput = 65504;

template <typename T>
T apply(Transfer transfer, const T& x) {
  using std::log;
  if (transfer == Transfer::kLinear) return x;
  return log(1 + 8 * x) / 3;
}

// Beyond an exponent of 80 the result is clamped whatever the roundings; exp stays finite in fp32.
template <typename T>
T invert(Transfer transfer, const T& y) {
  using std::exp, std::min;
  if (transfer == Transfer::kLinear) return y;
  return (exp(min(3 * y, T(80))) - 1) / 8;
}

}  // namespace raymeld::reference
