#pragma once

#include <functional>

#include "conform/conform.h"
#include "reference/samples.h"

namespace raymeld::conform {

// Says how a layer is computed: with which kernel, and with activations in buffers or by address.
struct Method {
  std::string name;
  Conv2dKernel kernel = {};
  bool addressed = false;
  bool half_dots = false;  // DeviceInfo::half_dots

  // These return the arguments of reference::conv2d() that have the same names.
  reference::Tile tile() const {
    const int m = std::max(int(kernel.winograd_tile()), 1);
    return {.down = m, .across = kernel.algorithm == Algorithm::kColumns ? 1 : m};
  }
  int units(reference::Precision precision) const {
    const bool dots =
        half_dots && kernel.algorithm == Algorithm::kDirect && precision == reference::Precision::kFp16;
    return dots || kernel.algorithm == Algorithm::kMatrix ? reference::kTensorUnits : 1;
  }
};

// Returns the direct kernel of convolutions, in buffers.
inline Method direct_method(const DeviceInfo& device) {
  return {.name = "direct", .half_dots = device.half_dots};
}
// Returns F(tile, 3) in columns.
inline Method columns_method(uint32_t tile) {
  return {.name = fmt::format("F({}, 3) in columns", tile),
          .kernel = {.algorithm = Algorithm::kColumns, .tile = tile}};
}
// Returns the methods of layers with a single kernel: in buffers and by address.
std::span<const Method> plain_methods();
// Returns two sizes of tiles, so small that a convolution has several, as far as the device's matrices and
// shared memory allow them. Where they allow neither, returns impossible tiles, whose cases are unsupported.
std::vector<MatrixTiles> matrix_tiles(const DeviceInfo& device, uint32_t kernel);

// Makes the comparisons of a case and keeps the worst of them in the case's finding.
class Check {
 public:
  explicit Check(Finding& finding) : finding_(finding) {}

  // Checks values against their bounds. Where a case has several comparisons, `what` names this one.
  void within(const reference::Planes& actual, const reference::Bounded& expected,
              const std::string& what = {});
  // Checks that the RMS error is at most `allowed`.
  void rms(const reference::Planes& actual, const reference::Planes& truth, double allowed,
           const std::string& what);
  // Checks for the same bits; any NaN equals any other.
  void same_bits(const reference::Planes& actual, const reference::Planes& expected,
                 const std::string& what = {});
  void that(bool holds, const std::string& otherwise);

 private:
  void take(const reference::Worst& worst, size_t values, const std::string& what);

  Finding& finding_;
};

class Collector {
 public:
  Collector(const Target& target, const Options& options) : target_(target), options_(options) {}

  const Target& target() const { return target_; }
  const Device& device() const { return target_.device; }
  const Options& options() const { return options_; }
  bool full() const { return options_.extent == Extent::kFull; }
  // Returns all awkward sizes in a full test, otherwise some.
  std::span<const reference::Size> sizes() const;

  // Runs one case, or reports it as unsupported where the device lacks a feature.
  void run(const std::string& layer, const Method& method, reference::Precision precision,
           const std::string& shape, const std::function<void(Check&)>& body) const;
  // Reports a case that cannot be tried; `missing` is the reason.
  void unsupported(const Case& of, const std::string& missing) const;
  // Calls `body` for all methods in both precisions, but for matrices in 16 bits only.
  static void for_each(std::span<const Method> methods,
                       const std::function<void(const Method&, reference::Precision)>& body);

 private:
  void judge(Finding finding, const std::function<void(Check&)>& body) const;

  const Target& target_;
  const Options& options_;
};

}  // namespace raymeld::conform
