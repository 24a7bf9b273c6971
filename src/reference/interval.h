#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "reference/bounds.h"

// An Interval holds all values that a device's fp32 result may have. Each operation widens it by the rounding
// that Vulkan allows (1.3, "Precision and Operation of SPIR-V Instructions"). A formula that is a template
// gives the value with double and the bounds with Interval.
namespace raymeld::reference {

inline constexpr double kUlp = 2 * kUnit;  // the largest size of one fp32 ULP, relative to the value

struct Interval {
  double low, high;

  Interval(double low, double high) : low(low), high(high) {}
  // Makes the interval of a shader's constant, which is rounded unless it is a float.
  Interval(double constant) : low(constant), high(constant) {
    if (double(float(constant)) == constant) return;
    low -= kUnit * std::abs(constant);
    high += kUnit * std::abs(constant);
  }
};

inline Interval rounded(const Interval& x, double relative) {
  return {x.low - relative * std::abs(x.low) - kFlush, x.high + relative * std::abs(x.high) + kFlush};
}

inline Interval operator-(const Interval& x) { return {-x.high, -x.low}; }

inline Interval operator+(const Interval& a, const Interval& b) {
  return rounded({a.low + b.low, a.high + b.high}, kUnit);
}

inline Interval operator-(const Interval& a, const Interval& b) { return a + -b; }

inline Interval product(const Interval& a, const Interval& b) {
  const auto [low, high] = std::minmax({a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high});
  return {low, high};
}

inline Interval operator*(const Interval& a, const Interval& b) { return rounded(product(a, b), kUnit); }

// The divisor must be positive.
inline Interval operator/(const Interval& a, const Interval& b) {
  return rounded(product(a, {1 / b.high, 1 / b.low}), 2.5 * kUlp);
}

inline double square(double x) { return x * x; }

inline Interval square(const Interval& x) {
  const double least = x.low > 0 ? x.low : x.high < 0 ? -x.high : 0, most = std::max(-x.low, x.high);
  return rounded({least * least, most * most}, kUnit);
}

inline Interval min(const Interval& a, const Interval& b) {
  return {std::min(a.low, b.low), std::min(a.high, b.high)};
}

inline Interval max(const Interval& a, const Interval& b) {
  return {std::max(a.low, b.low), std::max(a.high, b.high)};
}

inline Interval clamp(const Interval& x, double low, double high) {
  return {std::clamp(x.low, low, high), std::clamp(x.high, low, high)};
}

// Vulkan defines it as 1 / inversesqrt(x), with 2 ULP for inversesqrt and 2.5 ULP for the division. Only
// rounding makes values below zero.
inline Interval sqrt(const Interval& x) {
  return rounded({std::sqrt(std::max(x.low, 0.0)), std::sqrt(std::max(x.high, 0.0))}, 4.5 * kUlp);
}

// The result is within 3 + 2 |x| ULP.
inline Interval exp(const Interval& x) {
  const auto off = [](double x) { return std::exp(x) * (3 + 2 * std::abs(x)) * kUlp + kFlush; };
  return {std::max(0.0, std::exp(x.low) - off(x.low)), std::exp(x.high) + off(x.high)};
}

// The result is within 3 ULP, or within 2^-21 where x is in [0.5, 2]. The larger of both is used everywhere.
inline Interval log(const Interval& x) {
  const auto off = [](double log) { return std::max(3 * kUlp * std::abs(log), 0x1p-21); };
  const double low = x.low > 0 ? std::log(x.low) : -std::numeric_limits<double>::infinity();
  const double high = std::log(x.high);
  return {low - off(low), high + off(high)};
}

// The results have the errors of exp() and log().
inline Interval exp2(const Interval& x) {
  const auto off = [](double x) { return std::exp2(x) * (3 + 2 * std::abs(x)) * kUlp + kFlush; };
  return {std::max(0.0, std::exp2(x.low) - off(x.low)), std::exp2(x.high) + off(x.high)};
}

inline Interval log2(const Interval& x) {
  const auto off = [](double log) { return std::max(3 * kUlp * std::abs(log), 0x1p-21); };
  const double low = std::log2(x.low), high = std::log2(x.high);
  return {low - off(low), high + off(high)};
}

}  // namespace raymeld::reference
