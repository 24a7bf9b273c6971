#include "conform/collector.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <exception>
#include <limits>

#include "conform/supported.h"

namespace raymeld::conform {
namespace {

using reference::Bounded;
using reference::Planes;
using reference::Precision;
using reference::Worst;

bool same(double actual, double expected) {
  if (std::isnan(expected)) return std::isnan(actual);
  return std::bit_cast<uint64_t>(actual) == std::bit_cast<uint64_t>(expected);
}

}  // namespace

std::span<const Method> plain_methods() {
  static const std::array<Method, 2> methods{Method{.name = "in buffers"},
                                             Method{.name = "by address", .addressed = true}};
  return methods;
}

std::vector<MatrixTiles> matrix_tiles(const DeviceInfo& device, uint32_t kernel) {
  const CooperativeMatrix matrix = device.cooperative_matrix.value_or(CooperativeMatrix{});
  std::vector<MatrixTiles> tiles{
      {.matrix = matrix, .outputs = matrix.m, .rows = 1, .subgroups = 2, .channels = matrix.k},
      {.matrix = matrix, .outputs = 2 * matrix.m, .rows = 2, .subgroups = 1, .channels = 2 * matrix.k},
  };
  std::erase_if(tiles, [&](const MatrixTiles& one) { return !is_possible(one, kernel); });
  if (tiles.empty()) tiles.push_back({});
  return tiles;
}

void Check::take(const Worst& worst, size_t values, const std::string& what) {
  finding_.values += values;
  if (worst.ratio > 1) that(false, (what.empty() ? "" : what + ": ") + text_of(worst, values));
  // The first comparison is kept whatever its ratio.
  if (worst.ratio <= finding_.worst.ratio && finding_.values > values) return;
  finding_.worst = worst;
  finding_.where = what;
}

void Check::within(const Planes& actual, const Bounded& expected, const std::string& what) {
  take(reference::worst(actual, expected), actual.data.size(), what);
}

void Check::rms(const Planes& actual, const Planes& truth, double allowed, const std::string& what) {
  const double error = reference::rms_of_difference(actual, truth);
  const double ratio = error == 0 ? 0 : error / allowed;
  finding_.values += actual.data.size();
  finding_.rms_ratio = std::max(finding_.rms_ratio, ratio);
  that(ratio <= 1, fmt::format("{}: the RMS error is {:.3g}, allowed {:.3g}", what, error, allowed));
}

void Check::same_bits(const Planes& actual, const Planes& expected, const std::string& what) {
  Worst result = reference::worst(actual, reference::exact(expected));
  for (int c = 0; c < expected.c; ++c) {
    for (int y = 0; y < expected.h; ++y) {
      for (int x = 0; x < expected.w; ++x) {
        const double a = actual.at(c, y, x), e = expected.at(c, y, x);
        if (same(a, e) || a != e) continue;  // worst() has counted values that differ
        result = {.ratio = std::numeric_limits<double>::infinity(),
                  .c = c,
                  .y = y,
                  .x = x,
                  .actual = a,
                  .expected = e,
                  .bound = 0,
                  .failures = result.failures + 1};
      }
    }
  }
  take(result, actual.data.size(), what);
}

void Check::that(bool holds, const std::string& otherwise) {
  if (holds) return;
  finding_.outcome = Outcome::kFailed;
  finding_.message += (finding_.message.empty() ? "" : "; ") + otherwise;
}

std::span<const reference::Size> Collector::sizes() const {
  static const std::array<reference::Size, 5> some{{{1, 1}, {1, 19}, {9, 7}, {17, 15}, {3, 65}}};
  if (!full()) return some;
  return reference::awkward_sizes();
}

void Collector::run(const std::string& layer, const Method& method, Precision precision,
                    const std::string& shape, const std::function<void(Check&)>& body) const {
  const Case of{layer, method.name, precision, shape};
  const std::string missing = missing_feature(device().info(), method, precision);
  if (!missing.empty()) return unsupported(of, missing);
  judge({.of = of}, body);
}

void Collector::unsupported(const Case& of, const std::string& missing) const {
  options_.on_finding({.of = of, .outcome = Outcome::kUnsupported, .message = missing});
}

void Collector::judge(Finding finding, const std::function<void(Check&)>& body) const {
  Check check(finding);
  try {
    body(check);
    check.that(finding.values > 0, "nothing was compared");
  } catch (const std::exception& error) {
    check.that(false, error.what());
  }
  options_.on_finding(finding);
}

void Collector::for_each(std::span<const Method> methods,
                         const std::function<void(const Method&, Precision)>& body) {
  for (const Precision precision : kPrecisions) {
    for (const Method& method : methods) {
      if (method.kernel.algorithm != Algorithm::kMatrix || precision == Precision::kFp16)
        body(method, precision);
    }
  }
}

}  // namespace raymeld::conform
