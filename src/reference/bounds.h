#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace raymeld::reference {

// Holds values of shape (c, h, w), plane by plane, each with its rows from top to bottom.
struct Planes {
  int c = 0, h = 0, w = 0;
  std::vector<double> data;

  Planes() = default;
  Planes(int c, int h, int w) : c(c), h(h), w(w), data(size_t(c) * h * w, 0.0) {}
  Planes(int c, int h, int w, std::vector<double> values);  // throws std::invalid_argument on a wrong count
  size_t index(int ci, int y, int x) const { return (size_t(ci) * h + y) * w + x; }
  double& at(int ci, int y, int x) { return data[index(ci, y, x)]; }
  double at(int ci, int y, int x) const { return data[index(ci, y, x)]; }
};

// Says how a device stores values between layers. It accumulates in fp32 either way.
enum class Precision { kFp32, kFp16 };

// Rounds to nearest, ties to even, and keeps subnormals. The result is +-infinity from 65520 on.
double round_to_half(double value);
double round_to(double value, Precision precision);
Planes round_to(Planes planes, Precision precision);

// A right device's value lies in value +- bound; an infinite bound says that it may overflow.
struct Bounded {
  Planes value;
  Planes bound;
};
Bounded exact(Planes value);

inline constexpr double kUnit = 0x1p-24;      // u: relative error of one rounding to fp32
inline constexpr double kHalfUnit = 0x1p-11;  // h: relative error of one rounding to fp16
inline constexpr double kFlush = 0x1p-126;    // largest loss by flushing one subnormal fp32 result
double gamma(int roundings);                  // n u / (1 - n u)

// Returns the bound after a value with `bound` is stored: fp16 adds h (|value| + bound) + 2^-24. It is
// infinite where the stored value may overflow.
double stored_bound(double value, double bound, Precision precision);

// Holds the place where error / bound is largest. The ratio is infinite where a value that has to be exact is
// off, or where the bound is infinite. Equal infinities, and a NaN where one is expected, are no error.
struct Worst {
  double ratio = 0;
  int c = 0, y = 0, x = 0;
  double actual = 0, expected = 0, bound = 0;
  size_t failures = 0;  // values with a ratio above 1
};
Worst worst(const Planes& actual, const Bounded& expected);
// Returns the root of the mean square of the differences, without the largest hundredth of them: a pixel that
// is nearly clipped may have an error a thousand times that of all others, which leaves the mean to chance.
double rms_of_difference(const Planes& a, const Planes& b);

// The proved bounds are hundreds of times too wide where roundings cancel, as they mostly do. So there is a
// measured bound, which nothing proves: the RMS error of a right device is at most kRmsFactor times that of a
// scalar computation in floats, plus one rounding of the largest value.
inline constexpr double kRmsFactor = 4;
double allowed_rms(const Planes& truth, const Planes& in_floats, Precision precision);

// Returns "worst error / bound 1.2 at c 0, y 3, x 1: ..."; `values` is the number of compared values.
std::string text_of(const Worst& worst, size_t values);

}  // namespace raymeld::reference
